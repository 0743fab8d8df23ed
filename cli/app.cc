#include <algorithm>
#include <numeric>
#include <sstream>

#include "cli/command.h"

namespace slf::cli {
namespace {

constexpr const char* kFirstField = R"(
A first field:
  slf build brain.nii.gz -o brain.slf --transfer brain.json
  slf render brain.slf -o brain.png --orbit 30,20,3
)";

constexpr const char* kFooter = R"(
Exit codes: 0 done, 1 wrong arguments, 2 input or output failed (missing, permission, disk full),
3 a file is damaged or not what it claims, 4 failed at run time, 5 not supported, 7 differs.
Ctrl-C and SIGTERM end the program by that signal. A build first saves its finished tiles, except
for the last ones, of at most 256 KiB.
Bytes of paths and texts that are not UTF-8 become U+FFFD in JSON. In other output they and control
characters become \xNN.)";

constexpr const char* kListsCommands = "`slf --help` lists the commands";

/// The number of letters to insert, remove or replace to turn a into b.
std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j)
      diagonal = std::exchange(
          row[j + 1], std::min({row[j] + 1, row[j + 1] + 1, diagonal + (a[i] == b[j] ? 0 : 1)}));
  }
  return row.back();
}

/// "; did you mean 'render'?", or nothing if no name is similar.
std::string suggestion(const std::string& word, const std::vector<std::string>& names) {
  const auto near = [&](const std::string& name) { return edit_distance(word, name); };
  const auto nearest = std::ranges::min_element(names, {}, near);
  if (nearest == names.end() || 3 * near(*nearest) > std::max<std::size_t>(word.size(), 3))
    return "";
  return fmt::format("; did you mean '{}'?", *nearest);
}

std::string unknown_command(const CLI::App& app, const std::string& name) {
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands({})) names.push_back(command->get_name());
  return fmt::format("unknown command '{}'{}", shown(name), suggestion(name, names));
}

std::vector<std::string> option_names(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  return names;
}

/// The option that a message of CLI11 is about: the last that it names, which another one requires
/// or excludes. Errors of CLI11 do not say so in any other way.
const CLI::Option* option_of(const CLI::App& command, const std::string& message) {
  const CLI::Option* found = nullptr;
  std::istringstream words(message);
  for (std::string word; words >> word;) {
    if (word.ends_with(':')) word.pop_back();
    if (const CLI::Option* const option = command.get_option_no_throw(word)) found = option;
  }
  return found;
}

/// --help without rare options and those of other kinds of sources, which --help-all has.
class BriefFormatter : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App* app, std::string name,
                        CLI::AppFormatMode mode) const override {
    const CLI::Option* const input = app->get_option_no_throw("INPUT");
    Recipe recipe;
    if (input && !input->results().empty()) recipe.input = input->results().front();
    kinds_ = mode == CLI::AppFormatMode::All                   ? 0
             : recipe.input.empty() || is_recipe(recipe.input) ? unsigned{recipe::kAny}
                                                               : unsigned{recipe::kind_of(recipe)};
    std::string help = CLI::Formatter::make_help(app, name, mode);
    for (std::size_t at = 0; (at = help.find("\n\n\n", at)) != std::string::npos;)
      help.erase(at, 1);  // of groups that are left out
    return help;
  }

  std::string make_group(std::string group, bool is_positional,
                         std::vector<const CLI::Option*> options) const override {
    if (kinds_ != 0)
      std::erase_if(options, [&](const CLI::Option* option) {
        const recipe::Option* const row = row_of(*option);
        return group == kShardGroup || (row && (row->rare || !(row->kinds & kinds_)));
      });
    return options.empty() ? "" : CLI::Formatter::make_group(group, is_positional, options);
  }

  /// Of options of recipes, what stands before the first semicolon.
  std::string make_option_desc(const CLI::Option* option) const override {
    const std::string text = CLI::Formatter::make_option_desc(option);
    if (option->get_name() == "INPUT" && kinds_ == recipe::kVolume) return kVolumeHelp;
    return kinds_ != 0 && row_of(*option) ? text.substr(0, text.find(';')) : text;
  }

 private:
  mutable unsigned kinds_ = 0;  // of the help under way; 0: everything
};

void add_help(CLI::App& app, Run& run) {
  auto* command = app.add_subcommand("help", "The help of a command, or of slf");
  auto name = std::make_shared<std::string>();
  command->add_option("COMMAND", *name, "Name of a command");
  command->callback([&app, &run, name] {
    run = [&app, name]() -> Result<void> {
      const CLI::App* about = name->empty() ? &app : nullptr;
      for (const CLI::App* named : app.get_subcommands({}))
        if (named->get_name() == *name) about = named;
      if (!about) return fail(ErrorCode::usage, unknown_command(app, *name), "; ", kListsCommands);
      const std::string prefix = name->empty() ? "slf" : "slf " + *name;
      print_text(app.get_formatter()->make_help(about, prefix, CLI::AppFormatMode::Normal));
      return {};
    };
  });
}

}  // namespace

std::unique_ptr<CLI::App> make_app(Run& run) {
  auto app = std::make_unique<CLI::App>(
      "Builds, stores and renders sphere light fields: the colour of every ray through a sphere\n"
      "around a volume, so that any view is a look-up.",
      "slf");
  app->footer(kFooter);
  app->option_defaults()->always_capture_default();
  app->formatter(std::make_shared<BriefFormatter>());
  app->set_help_all_flag("--help-all", "Print all options and exit");
  app->set_version_flag("--version", std::string("slf ") + SLF_VERSION);
  app->add_flag("-q,--quiet", quiet, "No progress and no notes");
  add_progress(*app);
  add_cache(*app);
  app->require_subcommand(1);
  app->fallthrough();

  for (AddCommand* add :
       {add_build,    add_cameras, add_pictures, add_info,     add_render,  add_pick,
        add_play,     add_raycast, add_measure,  add_evaluate, add_compare, add_repack,
        add_reveal,   add_merge,   add_verify,   add_ls,       add_tile,    add_diff,
        add_transfer, add_view,    add_export,   add_help})
    add(*app, run);
  app->footer(std::string(kFirstField) + kFooter);
  for (CLI::App* command : app->get_subcommands({}))
    for (CLI::Option* option : command->get_options()) {
      const std::string type = option->get_type_name();
      if (type == "UINT" || type == "INT") option->type_name("N");
      if (type == "FLOAT") option->type_name("NUMBER");
      if (option->get_default_str() == "[]" ||
          option->get_description().find("default: ") != std::string::npos)
        option->default_str("");
    }
  return app;
}

std::string usage_message(const CLI::App& app, const CLI::ParseError& error) {
  const std::vector<CLI::App*> parsed = app.get_subcommands();
  const std::vector<std::string> extra = app.remaining(/*recurse=*/true);
  if (parsed.empty()) {
    for (const std::string& word : extra)
      if (!word.starts_with('-')) return unknown_command(app, word) + "\n" + kListsCommands;
    if (extra.empty()) return std::string("no command given\n") + kListsCommands;
  }
  const CLI::App& command = parsed.empty() ? app : *parsed.front();
  std::string text = shown(error.what());
  if (!extra.empty()) {
    std::vector<std::string> names = option_names(command);
    if (!parsed.empty()) std::ranges::copy(option_names(app), std::back_inserter(names));
    const std::string& word = extra.front();
    const bool option = word.starts_with('-');
    text = fmt::format("{} '{}'{}", option ? "unknown option" : "unexpected argument", shown(word),
                       option ? suggestion(word.substr(0, word.find('=')), names) : "");
  } else if (const CLI::Option* option = option_of(command, text)) {
    std::string help = option->get_description();
    std::ranges::replace(help, '\n', ' ');
    text += fmt::format("\n{} {}: {}", option->get_name(), option->get_type_name(), help);
  }
  return fmt::format("{}\n`slf {}--help` explains the options", text,
                     parsed.empty() ? "" : command.get_name() + " ");
}

}  // namespace slf::cli
