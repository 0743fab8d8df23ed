#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "cli/reference/model.h"

namespace slf::cli::reference {
namespace {

constexpr const char* kNotice = "Generated from the command line of slf. Do not edit.";

/// Quotes text with single quotes, in a form that all three shells read.
std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? "'\\''" : std::string(1, c);
  return out + "'";
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
  return text;
}

/// The first words of a description, because completion has little room.
std::string brief(const Argument& a) {
  constexpr std::size_t kMaxLength = 60;
  const std::string text = a.description.substr(0, a.description.find(';'));
  return text.size() <= kMaxLength ? text : text.substr(0, text.rfind(' ', kMaxLength)) + " ...";
}

const Argument* first_positional(const Command& command) {
  const auto at = std::ranges::find_if(command.arguments, &Argument::positional);
  return at == command.arguments.end() ? nullptr : &*at;
}

/// All options that may follow the name of a command.
std::vector<Argument> options_of(const Program& program, const Command& command) {
  std::vector<Argument> options;
  for (const Argument& a : command.arguments)
    if (!a.positional) options.push_back(a);
  for (const Argument& a : program.global.arguments)
    if (!a.positional && a.names.back() != "--version" && a.names.back() != "--help")
      options.push_back(a);
  return options;
}

std::string names_of(const std::vector<Argument>& options) {
  std::vector<std::string> names;
  for (const Argument& a : options) names.insert(names.end(), a.names.begin(), a.names.end());
  return fmt::format("{}", fmt::join(names, " "));
}

std::vector<std::string> command_names(const Program& program) {
  std::vector<std::string> names;
  for (const Command& command : program.commands) names.push_back(command.name);
  return names;
}

// ---- bash ---------------------------------------------------------------------------------------

/// The code that completes the value of an argument: a call of one of the functions below.
std::string bash_action(const Argument& a) {
  if (a.takes_folder()) return "_slf_folders";
  if (a.takes_file()) return "_slf_files " + quoted(a.extension());
  if (a.choices.empty()) return ":";
  return fmt::format("_slf_choices {}", quoted(fmt::format("{}", fmt::join(a.choices, " "))));
}

constexpr const char* kBashFunctions = R"(
_slf_folders() {
  compopt -o filenames 2>/dev/null
  mapfile -t COMPREPLY < <(compgen -d -- "$cur")
}

# Files with an ending ('': any), and folders.
_slf_files() {
  compopt -o filenames 2>/dev/null
  if [[ $1 ]]; then
    mapfile -t COMPREPLY < <(compgen -f -X "!*$1" -- "$cur"; compgen -d -- "$cur")
  else
    mapfile -t COMPREPLY < <(compgen -f -- "$cur")
  fi
}

# One of several words; after a comma, one more.
_slf_choices() {
  local before=
  if [[ $cur == *,* ]]; then before=${cur%,*},; fi
  mapfile -t COMPREPLY < <(compgen -P "$before" -W "$1" -- "${cur##*,}")
}

_slf() {
  local cur option= command= word glue= k
  local -a words=()
  COMPREPLY=()
  # Bash splits words at : and =, which are parts of ours.
  for ((k = 1; k <= COMP_CWORD; ++k)); do
    word=${COMP_WORDS[k]}
    if [[ $word == [:=]* && ${#words[@]} -gt 0 ]]; then
      words[-1]+=$word glue=1
    elif [[ $glue ]]; then
      words[-1]+=$word glue=
    else
      words+=("$word")
    fi
  done
  cur=${words[-1]}
  for word in "${words[@]:0:${#words[@]}-1}"; do
    if [[ $word != -* ]]; then command=$word; break; fi
  done
  if [[ $cur == --*=* ]]; then
    option=${cur%%=*} cur=${cur#*=}
  elif [[ ${#words[@]} -gt 1 && ${words[-2]} == -* ]]; then
    option=${words[-2]}
  fi
  _slf_of_command
  # The shell replaces only what follows the last colon.
  if [[ $cur == *:* ]]; then COMPREPLY=("${COMPREPLY[@]#"${cur%:*}:"}"); fi
}
complete -F _slf slf
)";

}  // namespace

std::string bash_completion(const Program& program) {
  std::string out = fmt::format("# bash completion for slf. {}\n", kNotice);
  out += "\n_slf_of_command() {\n  case $command in\n";
  out += fmt::format("    '') mapfile -t COMPREPLY < <(compgen -W '{} {}' -- \"$cur\") ;;\n",
                     fmt::join(command_names(program), " "), names_of(program.global.arguments));
  for (const Command& command : program.commands) {
    const auto options = options_of(program, command);
    out += fmt::format("    {})\n      case $option in\n", command.name);
    for (const Argument& a : options)
      if (!a.value.empty())
        out += fmt::format("        {}) {}; return ;;\n", fmt::join(a.names, "|"), bash_action(a));
    const Argument* positional = first_positional(command);
    out += fmt::format(
        "      esac\n      if [[ $cur == -* ]]; then\n"
        "        mapfile -t COMPREPLY < <(compgen -W '{}' -- \"$cur\")\n"
        "      else\n        {}\n      fi ;;\n",
        names_of(options), positional ? bash_action(*positional) : ":");
  }
  return out + "  esac\n}\n" + kBashFunctions;
}

// ---- zsh ----------------------------------------------------------------------------------------

namespace {

std::string zsh_escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == ':' || c == '[' || c == ']' || c == '\\') out += '\\';
    out += c;
  }
  return out;
}

std::string zsh_action(const Argument& a) {
  if (a.takes_folder()) return "_files -/";
  if (a.takes_file())
    return a.extension().empty() ? "_files" : fmt::format("_files -g \"*{}\"", a.extension());
  if (a.choices.empty()) return "";
  if (a.list) return fmt::format("_values -s , value {}", fmt::join(a.choices, " "));
  return fmt::format("({})", zsh_escaped(fmt::format("{}", fmt::join(a.choices, " "))));
}

/// One specification of _arguments: '(-o --output)'{-o,--output=}'[meaning]:FILE.slf:_files'.
std::string zsh_option(const Argument& a) {
  const std::string value =
      a.value.empty() ? "" : fmt::format(":{}:{}", zsh_escaped(a.value), zsh_action(a));
  const std::string rest = quoted("[" + zsh_escaped(brief(a)) + "]" + value);
  std::vector<std::string> names = a.names;
  if (!a.value.empty())
    for (std::string& name : names)
      if (name.starts_with("--")) name += "=";
  if (names.size() == 1) return names.front() + rest;
  return fmt::format("'({})'{{{}}}{}", fmt::join(a.names, " "), fmt::join(names, ","), rest);
}

}  // namespace

std::string zsh_completion(const Program& program) {
  std::string out =
      fmt::format("#compdef slf\n# zsh completion for slf. {}\n\n_slf() {{\n", kNotice);
  out += "  local curcontext=\"$curcontext\" state line\n  typeset -A opt_args\n  _arguments -C";
  for (const Argument& a : program.global.arguments) out += " \\\n    " + zsh_option(a);
  out += " \\\n    '1: :->command' '*:: :->arguments'\n  case $state in\n    command)\n";
  out += "      local -a commands=(\n";
  for (const Command& command : program.commands)
    out += "        " + quoted(command.name + ":" + zsh_escaped(command.description)) + "\n";
  out += "      )\n      _describe command commands ;;\n    arguments)\n      case $line[1] in\n";
  for (const Command& command : program.commands) {
    out += fmt::format("        {})\n          _arguments -s", command.name);
    for (const Argument& a : options_of(program, command))
      out += " \\\n            " + zsh_option(a);
    if (const Argument* positional = first_positional(command))
      out += " \\\n            " +
             quoted("*:" + positional->names.front() + ":" + zsh_action(*positional));
    out += " ;;\n";
  }
  return out + "      esac ;;\n  esac\n}\n\n_slf \"$@\"\n";
}

// ---- fish ---------------------------------------------------------------------------------------

namespace {

std::string fish_quoted(const std::string& text) {
  return "'" + replaced(replaced(text, "\\", "\\\\"), "'", "\\'") + "'";
}

/// The flags of `complete` for the value of an argument.
std::string fish_action(const Argument& a) {
  if (a.takes_folder()) return "-x -a '(__fish_complete_directories)'";
  if (a.takes_file() && a.extension().empty()) return "-r -F";
  if (a.takes_file()) return fmt::format("-x -k -a '(__fish_complete_suffix {})'", a.extension());
  const auto choices = fmt::format("{}", fmt::join(a.choices, " "));
  if (a.list && !a.choices.empty()) return fmt::format("-x -a '(__fish_append , {})'", choices);
  return a.choices.empty() ? "-x" : fmt::format("-x -a {}", fish_quoted(choices));
}

std::string fish_option(const std::string& condition, const Argument& a) {
  std::string line = fmt::format("complete -c slf -n {}", fish_quoted(condition));
  for (const std::string& name : a.names)
    line += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
  if (!a.value.empty()) line += " " + fish_action(a);
  return line + " -d " + fish_quoted(brief(a)) + "\n";
}

}  // namespace

std::string fish_completion(const Program& program) {
  std::string out = fmt::format("# fish completion for slf. {}\ncomplete -c slf -f\n", kNotice);
  for (const Command& command : program.commands)
    out += fmt::format("complete -c slf -n __fish_use_subcommand -a {} -d {}\n", command.name,
                       fish_quoted(command.description));
  for (const Argument& a : program.global.arguments) out += fish_option("__fish_use_subcommand", a);
  for (const Command& command : program.commands) {
    const std::string condition = "__fish_seen_subcommand_from " + command.name;
    for (const Argument& a : options_of(program, command)) out += fish_option(condition, a);
    if (const Argument* positional = first_positional(command);
        positional && positional->takes_file())
      out += fmt::format("complete -c slf -n {} {}\n", fish_quoted(condition),
                         replaced(replaced(fish_action(*positional), "-x ", ""), "-r ", ""));
  }
  return out;
}

}  // namespace slf::cli::reference
