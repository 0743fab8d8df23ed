#include "page/server.h"

#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <optional>

#include "base/file.h"
#include "base/try.h"
#include "cli/command.h"
#include "page/page.h"
#include "page/site.h"
#include "page/studio/studio.h"
#include "slf/field.h"

namespace slf::cli {
namespace {

constexpr const char* kViews = "Saved views and notes that the page shows (schemas/views.json)";
constexpr const char* kViewsFile = "VIEWS.json";
/// What the page shows first.
struct FirstArguments : page::First {
  void add_to(CLI::App& command) {
    add_state(command, "--state", state,
              "The state that the page shows first: its name or number, from 0");
    command
        .add_option("--structure", structures,
                    "A structure that the page shows first, as in slf render (repeatable)")
        ->type_name("NAME[:OPACITY][:#RRGGBB]")
        ->allow_extra_args(false);
  }
};

/// What the server says when it begins.
struct Serving {
  std::string url{};

  void describe(auto& member) const {
    member("url", url, "address of the page, or of a list of fields", R"("format": "uri")");
  }
};

struct ViewArguments {
  std::vector<std::string> inputs, frames;
  std::uint16_t port = 0;
  std::string bind, views;
  FirstArguments first;
  SourceArguments source;  // of a field that is to be made
  std::string output, save;
  unsigned threads = 0;
  bool open = false, json = false;
};

/// Starts the desktop's browser without a shell. The address has no character that a shell would
/// treat specially.
void open_browser(const std::string& url) {
  const pid_t child = fork();
  if (child != 0) return;
  setsid();  // Ctrl-C is not for the browser
  execlp("xdg-open", "xdg-open", url.c_str(), static_cast<char*>(nullptr));
  _exit(127);
}

/// Whether fields are to be shown, and not something that one can be made of. What does not exist
/// counts as one.
bool are_fields(const std::vector<std::string>& inputs) {
  if (inputs.size() != 1 || inputs[0].ends_with(".slf") || inputs[0].starts_with("http"))
    return true;
  std::error_code ignored;
  return (inputs[0].find(':') == std::string::npos &&
          !std::filesystem::exists(inputs[0], ignored)) ||
         Field::open(inputs[0]);
}

Result<std::unique_ptr<page::Studio>> make_studio(const ViewArguments& a,
                                                  std::optional<page::Server>& server) {
  SourceArguments source = a.source;
  SLF_TRY(recipe::set(source, "input", a.inputs[0]));
  const std::filesystem::path input = source.input;
  if (is_recipe(source.input)) SLF_TRY(hinted(read_recipe(std::string(source.input), source)));
  page::StudioOptions options;
  options.output = a.output;
  if (a.output.empty()) {
    // Of a folder, or of what follows "pictures:" or "scene:", its own name.
    std::filesystem::path whole = std::filesystem::absolute(input).lexically_normal();
    if (!whole.has_filename()) whole = whole.parent_path();
    std::string stem = whole.filename().string();
    stem = stem.substr(stem.find(':') + 1);
    options.output = stem.substr(0, stem.find('.', 1)) + ".slf";
  }
  options.save = a.save;
  if (is_recipe(input.string())) options.opened = input.string();
  options.threads = a.threads;
  options.show = [&server](const std::string& field) { return server->add(field); };
  return page::Studio::make(source, std::move(options));
}

Result<void> run_view(const ViewArguments& arguments) {
  if (page::page_files().empty()) return fail(ErrorCode::unsupported, page::no_page());
  page::ServerOptions options;
  std::optional<page::Server> server;  // which the studio will add its field to
  std::unique_ptr<page::Studio> studio;
  std::vector<std::string> fields = arguments.inputs;
  if (!are_fields(fields)) {
    studio = SLF_TRY(hinted(make_studio(arguments, server)));
    options.studio = [&](const page::Request& request, std::string_view rest) {
      return studio->answer(request, rest);
    };
    fields.clear();
  }
  options.port = arguments.port;
  options.frames = arguments.frames;
  if (!arguments.views.empty()) options.views = SLF_TRY(page::read_views(arguments.views));
  options.first = arguments.first;
  if (!arguments.bind.empty()) {
    options.address = arguments.bind;
    options.any_host = true;
  }
  server = SLF_TRY(hinted(page::Server::make(fields, options)));
  if (arguments.json)
    print_json(Serving{server->url()});
  else
    print("{}\n", server->url());
  std::fflush(stdout);
  note("Ctrl-C ends it");
  watch_signals();
  if (arguments.open) open_browser(server->url());
  return server->run([] { return stop_signal() != 0; });
}

struct ExportArguments {
  std::string field, output, views;
  FirstArguments first;
  page::ExportOptions options;
  bool force = false, no_reveal = false, json = false;
};

Result<void> run_export(const ExportArguments& a) {
  page::ExportOptions options = a.options;
  options.existing = a.force ? Existing::replace : Existing::keep;
  if (!a.views.empty()) options.views = SLF_TRY(page::read_views(a.views));
  options.first = a.first;
  options.repack.reveal = !a.no_reveal;
  if (!options.states.empty()) {
    const auto field = SLF_TRY(open_field(a.field));
    options.states = join_names(field, options.states);
  }
  const auto exported = page::export_field(a.field, a.output, options,
                                           progress_bar("export", "tiles", OnSignal::stop),
                                           progress_bar("export", "bytes", OnSignal::stop));
  SLF_TRY(with_force(hinted(exported).map([](const auto&) {})));
  if (a.json)
    print_json(*exported);
  else
    print("{}: a field of {}, finest level {}\n", a.output, human_bytes(exported->field_bytes),
          exported->level);
  return {};
}

}  // namespace

void add_view(CLI::App& app, Run& run) {
  const auto [command, a] =
      add_command(app, run, "view", "Show fields in a browser, or make one by looking", run_view);
  add_file(
      *command, "INPUT", a->inputs,
      "Fields to show; or one volume, mesh, set of pictures or recipe (as of slf build), whose\n"
      "colours, light and cuts are then chosen on the page, which saves and builds",
      kAnyFile)
      ->required();
  add_file(*command, "-o,--output", a->output,
           "The field that the page builds (default: the input's name, with .slf)");
  add_file(*command, "--save", a->save,
           "Where the page saves the recipe (default: beside the output, as NAME.recipe.json)");
  add_threads(*command, a->threads);
  command->add_option("--port", a->port, "Port to listen on; 0: any free one");
  command->add_option(
      "--bind", a->bind,
      "Listen on this address, for other machines too, and answer to any host name\n"
      "(default: 127.0.0.1, for this machine only)");
  command
      ->add_option("--allow-frames", a->frames,
                   "Let pages of these origins show the page in frames; those of this machine may\n"
                   "(repeatable)")
      ->type_name("ORIGIN")
      ->expected(1)
      ->take_all();
  command->add_option("--views", a->views, kViews)->type_name(kViewsFile);
  a->first.add_to(*command);
  a->source.add_to(*command,
                   [](const recipe::Option& option) { return option.use == recipe::Use::reading; });
  command->add_flag("--open", a->open, "Open the page in the desktop's browser");
  add_json<Serving>(*command, a->json);
}

void add_export(CLI::App& app, Run& run) {
  const auto [command, a] =
      add_command(app, run, "export", "Write a page that shows a field", run_export);
  add_file(*command, "FIELD", a->field, "Field to show", kFieldFile)->required();
  add_file(*command, "-o,--output", a->output,
           "NAME.html or NAME.htm: one file, which opens offline;\n"
           "otherwise a folder for any host of static files")
      ->required();
  command->add_option("--states", a->options.states, "As in slf repack")
      ->type_name("STATE,...")
      ->delimiter(',');
  command->add_option("--finest-level,--levels", a->options.repack.finest_level,
                      "The finest level to keep");
  command->add_option("--codec", a->options.repack.codec, "As in slf repack")->type_name(kCodec);
  add_no_depth(*command, a->options.repack.depth, "As in slf repack");
  command->add_flag("--no-reveal", a->no_reveal, "As in slf repack");
  add_bytes(*command, "--max-size", a->options.max_size,
            "Choose quality and levels so that the page fits; 0: no limit");
  command->add_option("--views", a->views, kViews)->type_name(kViewsFile);
  a->first.add_to(*command);
  command->add_option("--title", a->options.title, "What the page says it shows, above its views");
  command
      ->add_option("--url", a->options.url,
                   "Where the page will be, for the pictures of links to it in other programs")
      ->type_name("URL");
  command->add_flag("-f,--force", a->force, "Overwrite the output");
  add_json<page::ExportReport>(*command, a->json);
}

}  // namespace slf::cli
