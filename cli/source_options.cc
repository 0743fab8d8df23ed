// The options of recipes on the command line, and what they need beside their values: hints and
// progress.
#include <algorithm>

#include "base/join.h"
#include "base/try.h"
#include "cli/command.h"

namespace slf::cli {
namespace {

constexpr std::size_t kHelpWidth = 80;

std::string option_name(std::string_view name) {
  std::string option = concat("--", name);
  std::ranges::replace(option, '_', '-');
  return option;
}

std::string type_name(const recipe::Type& type) {
  return type.names.empty() ? type.shown : concat(type.shown, ":{", joined(type.names, ","), "}");
}

/// What --help says of the option.
std::string help_on_command_line(const recipe::Option& option) {
  std::string help = recipe::help_of(option, /*command_line=*/true);
  if (option.type.form == recipe::Type::Form::bytes) help += kBytesHelp;
  return filled(help, kHelpWidth);
}

std::map<const CLI::Option*, const recipe::Option*>& rows() {
  static std::map<const CLI::Option*, const recipe::Option*> all;
  return all;
}

void add_option(CLI::App& command, const recipe::Option& option, Recipe& to) {
  const OptionGroup group(command, option.group);
  const auto set = [&option, &to](const nlohmann::json& value) {
    if (const auto ok = recipe::set(to, option.name, value); !ok)
      throw CLI::ValidationError(ok.error().message);
  };
  const std::string help = help_on_command_line(option);
  std::string names = option.negative ? option.negative : option_name(option.name);
  if (option.former) names += "," + option_name(option.former);
  if (option.type.form == recipe::Type::Form::flag) {
    rows()[command.add_flag_callback(
        names, [=, on = !option.negative] { set(on); }, help)] = &option;
    return;
  }
  auto* added = command.add_option_function<std::vector<std::string>>(
      names,
      [=, &type = option.type](const std::vector<std::string>& texts) {
        nlohmann::json value;
        for (const std::string& text : texts) {
          auto one = recipe::parse(type, text);
          if (!one) throw CLI::ValidationError(one.error().message);
          if (value.is_array())
            value.insert(value.end(), one->begin(), one->end());
          else
            value = std::move(*one);
        }
        set(value);
      },
      help);
  rows()[added] = &option;
  const bool repeats = option.type.form == recipe::Type::Form::planes;
  added->expected(1, repeats ? 64 : 1)->allow_extra_args(false)->type_name(type_name(option.type));
  added->check(CLI::Validator(
      [&type = option.type](const std::string& text) {
        const auto value = recipe::parse(type, text);
        return value ? "" : value.error().message;
      },
      ""));
  added->default_str(option.otherwise.value_or(text_of(option.type, option.get(Recipe()))));
}

}  // namespace

const recipe::Option* row_of(const CLI::Option& option) {
  const auto found = rows().find(&option);
  return found == rows().end() ? nullptr : found->second;
}

SourceArguments::SourceArguments() {
  on_note = [](const std::string& text, const char* choice) {
    note(choice ? text + "; " + hint_of(choice) : text);
  };
}

Result<void> SourceArguments::finish(unsigned threads, OnSignal on_signal) {
  light_volume.threads = threads;
  light_volume.progress = light_progress(on_signal);
  pictures.progress = late_progress_bar("pictures", "pictures", OnSignal::end);
  if (is_recipe(input)) SLF_TRY(hinted(read_recipe(std::string(input), *this)));
  if (!states_file.empty()) SLF_TRY(hinted(read_recipe(states_file, *this)));
  return {};
}

std::string hint_of(std::string_view choice) {
  static const std::map<std::string_view, const char*> others{
      {"raw", "for example `--dims 128x128x84 --type u8 --spacing 1x1x1.5 --offset 62`"},
      {"layout", "see --dims, --type, --spacing and --offset"},
      {"transfer", "see --transfer and --range"},
      {"sphere", "see --center and --radius"},
      {"center", "see --center and --radius"},
      {"fix", "`slf verify --fix` drops damaged tiles, and the build that made them refills them"},
      {"depth", "see --depth-kind and --depth-scale"},
      {"tone", "see --color-type and --lighting of `slf build`"}};
  if (const auto found = others.find(choice); found != others.end()) return found->second;
  return "see " + option_name(choice);
}

void SourceArguments::add_input_to(CLI::App& command, const char* name) {
  command
      .add_option_function<std::string>(
          name,
          [this](const std::string& path) {
            input = path;
            stated.insert(recipe::find("input")->name);
          },
          kVolumeHelp + ", or\n" + kMeshHelp + ", or\n" +
              "pictures:FOLDER or pictures:JSON, with cameras (doc/pictures.md), or\n"
              "scene:balls, scene:globe, scene:fog, or\n"
              "a recipe (.json), which states any of these, and options (doc/recipes.md)")
      ->type_name(kAnyFile)
      ->required();
}

void SourceArguments::add_to(CLI::App& command,
                             const std::function<bool(const recipe::Option&)>& wanted) {
  for (const recipe::Option& option : recipe::options())
    if (option.use != recipe::Use::input && wanted(option)) add_option(command, option, *this);
  for (const recipe::Option& option : recipe::options()) {
    auto* const added = command.get_option_no_throw(option_name(option.name));
    const auto other = [&](const char* name) {
      return added && name ? command.get_option_no_throw(option_name(name)) : nullptr;
    };
    if (auto* needed = other(option.needs)) added->needs(needed);
    if (auto* excluded = other(option.excludes)) added->excludes(excluded);
  }
}

void SourceArguments::add_states_to(CLI::App& command) {
  add_file(command, "--states", states_file,
           "States of the object, in one field: a JSON file of their names and options\n"
           "(doc/states.md)");
}

}  // namespace slf::cli
