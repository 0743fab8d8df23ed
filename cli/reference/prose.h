// The parts of the manual pages that no option says: what a command is for, and examples.
#pragma once

#include <string>
#include <vector>

namespace slf::cli::reference {

struct Example {
  const char* purpose;
  const char* line;
};

struct Prose {
  const char* command;  ///< "build"; "" is slf(1)
  std::vector<const char*> paragraphs;
  std::vector<Example> examples;
};

/// Throws std::runtime_error for a command that has none: a new command needs its paragraph.
[[nodiscard]] const Prose& prose(const std::string& command);

}  // namespace slf::cli::reference
