#include "cli/reference/model.h"

#include <algorithm>

#include "cli/command.h"

namespace slf::cli::reference {
namespace {

/// Joins the lines of a description in --help.
std::string one_line(const std::string& text) {
  std::string line;
  for (const char c : text)
    if (c != '\n')
      line += c;
    else if (!line.empty() && line.back() != ' ')
      line += ' ';
  return line;
}

/// Parses CLI11's description of a value: "TEXT:{u8,half}", "UINT:INT in [0 - 1000]" or, if names
/// stand for values, "TEXT:value in {a->0,b->1} OR {0,1}".
void read_type(const std::string& type, Argument& argument) {
  const std::size_t colon = type.find(':');
  argument.value = type.substr(0, colon);
  if (colon == std::string::npos) return;
  const std::string check = type.substr(colon + 1);
  const std::size_t open = check.find('{'), close = check.find('}');
  if (open == std::string::npos || close == std::string::npos) {
    argument.range = check;
    return;
  }
  std::istringstream choices(check.substr(open + 1, close - open - 1));
  for (std::string choice; std::getline(choices, choice, ',');)
    argument.choices.push_back(choice.substr(0, choice.find("->")));
}

/// Values that completion offers for arguments that also accept others.
std::vector<std::string> suggestions(const std::string& value) {
  if (value == kCodec)
    return {"predictive:75", "predictive:90", "predictive:lossless", "raw", "zstd", "zstd:9",
            "jpeg:75",       "jpeg:90"};
  return {};
}

Argument describe(const CLI::Option& option) {
  Argument a;
  a.positional = option.get_positional();
  if (a.positional) a.names.push_back(option.get_name(true));
  for (const auto& name : option.get_snames()) a.names.push_back("-" + name);
  for (const auto& name : option.get_lnames()) a.names.push_back("--" + name);
  a.required = option.get_required();
  // CLI11 also counts the numbers of a vector such as X,Y,Z; these are not repeated values.
  a.repeated = option.get_items_expected_max() > option.get_items_expected_min();
  a.list = a.repeated && option.get_delimiter() == ',';
  if (option.get_items_expected_max() > 0) read_type(option.get_type_name(), a);
  a.initial = option.get_default_str();
  if (a.repeated && a.initial.starts_with('['))
    a.initial = a.initial.substr(1, a.initial.size() - 2);
  a.description = one_line(option.get_description());
  a.group = option.get_group();
  if (a.choices.empty())
    a.choices = suggestions(a.value);
  else
    a.closed = true;
  return a;
}

Command describe_command(const CLI::App& app) {
  Command command;
  command.name = app.get_name();
  command.description = one_line(app.get_description());
  const CLI::App* parent = app.get_parent();
  if (parent && app.get_footer() != parent->get_footer())
    command.notes = one_line(app.get_footer());
  for (const CLI::Option* option : app.get_options())
    if (!option->get_group().empty())  // no group: hidden
      command.arguments.push_back(describe(*option));
  return command;
}

}  // namespace

bool Argument::takes_file() const { return value.starts_with(kAnyFile); }
bool Argument::takes_folder() const { return value == kFolder; }
std::string Argument::extension() const {
  return takes_file() ? value.substr(std::string_view(kAnyFile).size()) : "";
}

std::vector<std::string> Command::groups() const {
  std::vector<std::string> groups;
  for (const Argument& argument : arguments)
    if (!argument.positional && std::ranges::find(groups, argument.group) == groups.end())
      groups.push_back(argument.group);
  return groups;
}

Program describe(const CLI::App& app) {
  Program program{describe_command(app), {}};
  for (const CLI::App* command : app.get_subcommands({}))
    program.commands.push_back(describe_command(*command));
  return program;
}

}  // namespace slf::cli::reference
