#include "view/server.h"

#include <fcntl.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <optional>

#include "base/file.h"
#include "base/try.h"
#include "cli/command.h"
#include "slf/repack.h"
#include "view/fit.h"
#include "view/page.h"
#include "view/site.h"

namespace slf::cli {
namespace {

constexpr const char* kViews = "Saved views and notes that the page shows (schemas/views.json)";
constexpr const char* kViewsFile = "VIEWS.json";
constexpr const char* kFirstState =
    "The state that the page shows first: its name or number, from 0";

struct ViewArguments {
  std::vector<std::string> fields, frames;
  std::uint16_t port = 0;
  std::string bind, views, state;
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

/// The name of a state that is given by its name or number, if it is.
Result<std::string> state_name(const Field& field, const std::string& state) {
  const auto shown = SLF_TRY(show_state(field, state));
  return state.empty() || field.states().empty() ? "" : field.states()[shown.state()];
}

Result<void> run_view(const ViewArguments& arguments) {
  if (view::page_files().empty()) return fail(ErrorCode::unsupported, view::no_page());
  view::ServerOptions options;
  options.port = arguments.port;
  options.frames = arguments.frames;
  if (!arguments.views.empty()) options.views = SLF_TRY(view::read_views(arguments.views));
  if (!arguments.state.empty()) {
    if (arguments.fields.size() > 1) return fail(ErrorCode::usage, "--state: only with one field");
    const auto field = SLF_TRY(Field::open(arguments.fields[0]));
    options.state = SLF_TRY(state_name(field, arguments.state));
  }
  if (!arguments.bind.empty()) {
    options.address = arguments.bind;
    options.any_host = true;
  }
  auto server = SLF_TRY(view::Server::make(arguments.fields, options));
  if (arguments.json)
    print_json({{"url", server.url()}});
  else
    print("{}\n", server.url());
  std::fflush(stdout);
  note("Ctrl-C ends it");
  watch_signals();
  if (arguments.open) open_browser(server.url());
  return server.run([] { return stop_signal() != 0; });
}

struct ExportArguments {
  std::string field, output, views, state;
  std::vector<std::string> states;
  RepackOptions repack;
  std::uint64_t max_size = 0;  // 0: any
  bool force = false, json = false;

  [[nodiscard]] Existing existing() const { return force ? Existing::replace : Existing::keep; }
};

/// Makes a smaller field if the options request one; otherwise the field is exported unchanged, as
/// are several states for the sake of their light, since they would be encoded again. It loses the
/// name `path` at once, so that nothing remains if the process is killed.
Result<std::optional<Field>> repack_if_requested(const ExportArguments& a,
                                                 const std::string& path) {
  std::vector<StateSource> states;
  SLF_TRY(add_states(a.field, a.states, states));
  const Field& field = states.front().field;
  RepackOptions options = a.repack;
  options.light = false;  // views do not need it
  const bool limited = a.max_size > 0, one_file = view::is_page_name(a.output);
  const std::uint64_t room = view::room_for_field(a.max_size, one_file);
  if (limited && room == 0)
    return fail(ErrorCode::usage, "--max-size: the page alone is larger; allow 1MiB or more");
  const auto light = field.light();
  const bool drops_light = states.size() == 1 && (!light || !light->empty());
  const bool as_it_is =
      !drops_light && a.states.empty() && !options.levels && options.codec.empty() && options.depth;
  // In a folder, a field without an index gets one and so becomes larger; a repacked one has it.
  const bool fits = !limited || (one_file && field.file_bytes() <= room);
  if (as_it_is && fits) return std::nullopt;
  std::error_code ignored;
  if (std::filesystem::exists(std::filesystem::symlink_status(path, ignored)))
    return misuse(path, "exists; move or remove it: the export needs its name");
  const auto bar = progress_bar("export", "tiles", OnSignal::stop);
  SLF_TRY(limited ? view::repack_to_fit(states, path, options, room, bar)
                  : join_states(states, path, options, bar));
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);  // until the process ends
  unlink(path.c_str());
  return Field::open(path_of_descriptor(file));
}

Result<void> run_export(const ExportArguments& a) {
  SLF_TRY(with_force(view::check_export(a.field, a.output, a.existing())));
  std::string base = a.output;
  while (base.size() > 1 && base.back() == '/') base.pop_back();
  const auto field = SLF_TRY(Field::open(a.field));
  view::Views views;
  if (!a.views.empty()) {
    const auto file = SLF_TRY(view::read_views(a.views));
    views = SLF_TRY(view::parse_views(file, field.shape().sphere));
  }
  const auto repacked = SLF_TRY(repack_if_requested(a, base + ".exporting"));
  const Field& exported = repacked ? *repacked : field;
  const auto shown = state_name(exported, a.state);
  if (!shown)
    return repacked ? fail(ErrorCode::usage, "--state ", a.state, ": not one of --states")
                    : tl::unexpected(shown.error());
  view::begin_with(*shown, exported, views);
  SLF_TRY(with_force(view::export_field(exported.path(), a.field, a.output, views, a.existing(),
                                        progress_bar("export", "bytes", OnSignal::stop))));
  const std::uint64_t bytes = exported.file_bytes();
  if (a.json)
    print_json({{"output", a.output}, {"field_bytes", bytes}, {"level", exported.shape().levels}});
  else
    print("{}: a field of {}, finest level {}\n", a.output, human_bytes(bytes),
          exported.shape().levels);
  return {};
}

}  // namespace

void add_view(CLI::App& app, Run& run) {
  const auto [command, a] = add_command(app, run, "view", "Show fields in a browser", run_view);
  add_file(*command, "FIELD", a->fields, "Fields to show", kFieldFile)->required();
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
  add_state(*command, "--state", a->state, kFirstState);
  command->add_flag("--open", a->open, "Open the page in the desktop's browser");
  command->add_flag("--json", a->json, "JSON on stdout");
}

void add_export(CLI::App& app, Run& run) {
  const auto [command, a] =
      add_command(app, run, "export", "Write a page that shows a field", run_export);
  add_file(*command, "FIELD", a->field, "Field to show", kFieldFile)->required();
  add_file(*command, "-o,--output", a->output,
           "NAME.html or NAME.htm: one file, which opens offline;\n"
           "otherwise a folder for any host of static files")
      ->required();
  command->add_option("--states", a->states, "As in slf repack")
      ->type_name("STATE,...")
      ->delimiter(',');
  command->add_option("--levels", a->repack.levels, "The finest level to keep");
  command->add_option("--codec", a->repack.codec, "As in slf repack")->type_name(kCodec);
  add_no_depth(*command, a->repack.depth, "As in slf repack");
  add_bytes(*command, "--max-size", a->max_size,
            "Choose quality and levels so that the page fits; 0: no limit");
  command->add_option("--views", a->views, kViews)->type_name(kViewsFile);
  add_state(*command, "--state", a->state, kFirstState);
  command->add_flag("-f,--force", a->force, "Overwrite the output");
  command->add_flag("--json", a->json, "JSON on stdout");
}

}  // namespace slf::cli
