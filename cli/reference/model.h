// What the command line of `slf` consists of, as plain data: read from CLI11's own description of
// the commands, written out as manual pages and as completion for three shells.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace slf::cli::reference {

/// An option, a flag or a positional argument.
struct Argument {
  std::vector<std::string> names;  ///< "-o", "--output"; of a positional its name alone
  bool positional = false;
  bool required = false;
  bool repeated = false;    ///< takes several values
  bool list = false;        ///< several values may be written as one word, separated by commas
  std::string value;        ///< what its value is, "FILE.slf"; empty: a flag
  std::string range;        ///< "INT in [0 - 1000]", or empty
  std::string initial;      ///< the value where it is not given, or empty
  std::string description;  ///< one line
  std::string group;        ///< heading in --help
  std::vector<std::string> choices;  ///< values to offer
  bool closed = false;               ///< it takes no other values than those

  [[nodiscard]] bool takes_file() const;  ///< any file or one with extension()
  [[nodiscard]] bool takes_folder() const;
  [[nodiscard]] std::string extension() const;  ///< ".slf", or empty
};

struct Command {
  std::string name;
  std::string description;  ///< one line
  std::string notes;        ///< what --help says below the options, where it is this command's own
  std::vector<Argument> arguments;

  /// The headings of its options, in the order of --help.
  [[nodiscard]] std::vector<std::string> groups() const;
};

/// The program: options that go with every command, and the commands.
struct Program {
  Command global;
  std::vector<Command> commands;
};

[[nodiscard]] Program describe(const CLI::App& app);

// ---- output ------------------------------------------------------------------------------------

/// The manual page slf(1), in troff's language.
[[nodiscard]] std::string program_manual(const Program& program);
/// slf-NAME(1).
[[nodiscard]] std::string command_manual(const Program& program, const Command& command);

[[nodiscard]] std::string bash_completion(const Program& program);
[[nodiscard]] std::string zsh_completion(const Program& program);
[[nodiscard]] std::string fish_completion(const Program& program);

}  // namespace slf::cli::reference
