// The command line of `slf` as plain data. It is read from CLI11's description of the commands, and
// written as manual pages and as completion for three shells.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace slf::cli::reference {

/// An option, a flag or a positional argument.
struct Argument {
  std::vector<std::string> names;  ///< "-o", "--output"; for a positional its name alone
  bool positional = false;
  bool required = false;
  bool repeated = false;    ///< takes several values
  bool list = false;        ///< several values may be written as one word, separated by commas
  std::string value;        ///< kind of its value, such as "FILE.slf"; empty: a flag
  std::string range;        ///< "INT in [0 - 1000]", or empty
  std::string initial;      ///< the default value, or empty
  std::string description;  ///< one line
  std::string group;        ///< heading in --help
  std::vector<std::string> choices;  ///< values to offer
  bool closed = false;               ///< only `choices` are valid

  [[nodiscard]] bool takes_file() const;  ///< any file or one with extension()
  [[nodiscard]] bool takes_folder() const;
  [[nodiscard]] std::string extension() const;  ///< ".slf", or empty
};

struct Command {
  std::string name;
  std::string description;  ///< one line
  std::string notes;        ///< text of --help below the options, if the command has any
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

/// The manual page slf(1), as troff source.
[[nodiscard]] std::string program_manual(const Program& program);
/// slf-NAME(1).
[[nodiscard]] std::string command_manual(const Program& program, const Command& command);

[[nodiscard]] std::string bash_completion(const Program& program);
[[nodiscard]] std::string zsh_completion(const Program& program);
[[nodiscard]] std::string fish_completion(const Program& program);

}  // namespace slf::cli::reference
