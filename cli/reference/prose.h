// The parts of the manual pages that --help lacks: the purpose of each command, and examples.
#pragma once

#include <string>
#include <vector>

namespace slf::cli::reference {

struct Example {
  const char* purpose;
  const char* line;
};

struct Prose {
  const char* command;  ///< such as "build"; "" for slf(1)
  std::vector<const char*> paragraphs;
  std::vector<Example> examples;
};

/// The text of a command. Throws std::runtime_error if there is none: every command needs one.
[[nodiscard]] const Prose& prose(const std::string& command);

}  // namespace slf::cli::reference
