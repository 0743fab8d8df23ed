// Shared by the commands of `slf`: running, printing, and options that several commands have.
//
// Data goes to stdout, progress and messages to stderr. The exit code is that of the
// failure, 0 on success.
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <concepts>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/report.h"
#include "slf/build.h"
#include "slf/camera.h"
#include "slf/cut.h"
#include "slf/error.h"
#include "slf/field.h"
#include "slf/recipe.h"
#include "slf/remote.h"
#include "slf/render.h"
#include "slf/repack.h"
#include "source/recipe/options.h"

namespace slf::cli {

/// The work of a command, to be done once the command line is parsed. The subcommand's callback
/// sets it.
using Run = std::function<Result<void>()>;

/// The command line of `slf` with all of its commands. Parsing sets `run`, which must outlive it.
[[nodiscard]] std::unique_ptr<CLI::App> make_app(Run& run);

/// The message for a command line that `app` could not parse: the error, and what was expected.
[[nodiscard]] std::string usage_message(const CLI::App& app, const CLI::ParseError& error);

/// Prints what may stand in the place of the last of the words after `slf`, for shells.
void complete(const CLI::App& app, std::vector<std::string> words);

/// Adds a command, one of those that are listed in cli/app.cc.
using AddCommand = void(CLI::App& app, Run& run);
AddCommand add_build, add_cameras, add_pictures, add_info, add_render, add_pick, add_play,
    add_raycast, add_measure, add_evaluate, add_compare, add_repack, add_reveal, add_merge,
    add_verify, add_ls, add_tile, add_diff, add_transfer, add_view, add_export;

// ---- output ------------------------------------------------------------------------------------

/// --quiet: suppresses progress and notes.
extern bool quiet;
/// --progress: how progress is reported, and how often if stderr is not a terminal.
struct ProgressStyle {
  bool json = false;    ///< lines of JSON, for programs
  double seconds = 30;  ///< between lines; 0: no lines
};
extern ProgressStyle progress_style;
/// Adds --progress.
void add_progress(CLI::App& app);
/// Parses "30", "json" or "json:5".
std::istream& operator>>(std::istream& in, ProgressStyle& style);

/// Opens those of descriptors 0 to 2 that are closed, so that no file that the program opens gets
/// their numbers. Output to them still fails.
void reserve_standard_streams();

/// The text with control characters and bytes that are not UTF-8 written as \xNN, so that untrusted
/// text cannot control a terminal. Tabs stay, and so do line feeds if `lines` is any. If it is
/// indented, only those before two spaces do: then no name of a file can begin a line.
enum class Lines { any, indented };
[[nodiscard]] std::string printable(std::string_view text, Lines lines = Lines::any);

/// Prints printable(text) on stdout. main() checks at the end whether all output was written.
void print_text(std::string_view text);

/// What print() shows of an argument: text in one line, anything else as it is.
template <class T>
[[nodiscard]] decltype(auto) shown(const T& argument) {
  if constexpr (std::is_convertible_v<const T&, std::string_view>)
    return printable(argument, Lines::indented);
  else
    return (argument);
}
/// Prints as std::print() does. Line feeds come from the format alone.
template <class... T>
void print(fmt::format_string<decltype(shown(std::declval<T>()))...> format,
           const T&... arguments) {
  print_text(fmt::format(format, shown(arguments)...));
}

/// Prints printable(text, lines) as a line on stderr. Ignores errors of stderr.
void message(const std::string& text, Lines lines = Lines::indented);
/// As message(), unless quiet.
void note(const std::string& text);

/// Prints JSON on stdout. Bytes that are not UTF-8, as in paths, become U+FFFD. If a remote field
/// was read, adds the member "http", its traffic, to an object.
void print_document(nlohmann::json json);
/// The same of a report, or of a list of reports (base/report.h).
template <class T>
void print_json(const T& report) {
  print_document(report::json_of(report));
}

/// The schemas of what commands print with --json; of lines: of each line.
struct OutputSchema {
  std::string title;
  std::vector<nlohmann::json (*)()> alternatives;
  bool lines = false;
};
extern std::map<std::string, OutputSchema> output_schemas;

/// Adds --json to a command that prints one of these reports with print_json().
template <class... Reports>
void add_json(CLI::App& command, bool& json, const std::string& help = "JSON on stdout") {
  command.add_flag("--json", json, help);
  output_schemas[command.get_name()] = {"Output of `slf " + command.get_name() + " --json`",
                                        {&report::schema_of<Reports>...}};
}

/// The text member `key` of untrusted JSON, or `otherwise` if there is none.
[[nodiscard]] std::string text_of(const nlohmann::json& json, const char* key,
                                  const std::string& otherwise);

/// Formats numbers as "1.5 GiB", "12.3 M" and, of seconds, "2:05".
[[nodiscard]] std::string human_time(double seconds);
[[nodiscard]] std::string human_bytes(double bytes);
[[nodiscard]] std::string human_count(double count);
template <std::integral T>
[[nodiscard]] std::string human_bytes(T bytes) {
  return human_bytes(static_cast<double>(bytes));
}
template <std::integral T>
[[nodiscard]] std::string human_count(T count) {
  return human_count(static_cast<double>(count));
}

/// Prints rows of cells, which are separated by tabs. All columns but the first are right-aligned.
void print_table(const std::vector<std::string>& rows);

/// Of commands that write a field, unless they are given one, or a tile needs more.
inline constexpr std::uint64_t kDefaultBudget = 256 << 20;
/// Says that a command which was `given` no budget, 0, has used more.
void note_budget(const std::string& output, std::uint64_t given, std::uint64_t used);

/// Makes malloc return freed blocks above 1/256 of a command's budget to the system, and keep
/// smaller ones, because mapping each anew would take longer than copying it. If it kept large
/// ones, the heap would grow without end, in pieces that are too small for the next tile.
void bound_freed_memory(std::uint64_t budget);

// ---- fields ------------------------------------------------------------------------------------

/// Opens a local field or one on a web server, in a state by its name or number. Errors as
/// Field::open(), RemoteField::open() and Field::in_state().
[[nodiscard]] Result<Field> open_field(const std::string& path, const std::string& state = {});

/// The names of states in a list that was split at commas, of which they may have some themselves.
[[nodiscard]] std::vector<std::string> join_names(const Field& field,
                                                  std::span<const std::string> split);

/// A field, and the state of it to show.
struct FieldArguments {
  std::string path, state;

  void add_to(CLI::App& command, const char* help);
  [[nodiscard]] Result<Field> open() const { return open_field(path, state); }
};
void add_state(CLI::App& command, const char* name, std::string& state, const char* help);

/// Whether the path is an address, or that of a file that is a field by its name or its bytes.
[[nodiscard]] bool is_field(const std::string& path);

/// Adds the options of the cache of remote fields.
void add_cache(CLI::App& app);

/// The requests and bytes of all remote fields so far; none if none was opened.
[[nodiscard]] std::optional<RemoteTraffic> traffic();

// ---- progress and signals ----------------------------------------------------------------------

/// What the first SIGINT or SIGTERM does during some work.
enum class OnSignal {
  end,   ///< ends the process: nothing is half done that a later run could not do again
  stop,  ///< the progress callback returns false, so that the work saves or removes what it has
         ///< made
};

/// Shows rate and time left on stderr, in `unit`s: as a bar on a terminal, otherwise as lines in
/// progress_style. With OnSignal::stop, the first call of the callback calls watch_signals(). So
/// signals end the process at once while work is planned, and functions call back before they
/// create a file.
[[nodiscard]] ProgressCallback progress_bar(const std::string& title, const std::string& unit,
                                            OnSignal on_signal);

/// From now on the first SIGINT or SIGTERM only sets stop_signal(); the second one ends the
/// process.
void watch_signals();

/// As progress_bar(), for work that may not be needed: the bar appears with the first call.
[[nodiscard]] ProgressCallback late_progress_bar(const std::string& title, const std::string& unit,
                                                 OnSignal on_signal);
/// That of a light volume. There is no call if the light volume is read from a file.
[[nodiscard]] ProgressCallback light_progress(OnSignal on_signal);

/// The signal that asked the program to stop, or 0.
[[nodiscard]] int stop_signal();

// ---- arguments ---------------------------------------------------------------------------------

/// Kinds of values. --help shows them, and they determine shell completion.
inline constexpr const char* kFieldFile = "FILE.slf";
inline constexpr const char* kAnyFile = "FILE";
inline constexpr const char* kFolder = "DIR";
inline constexpr const char* kCodec = "CODEC";
inline constexpr const char* kVector = "X,Y,Z";
/// What --help says of a number of bytes.
inline constexpr const char* kBytesHelp = ", in bytes or as 64MiB, 2GiB";

/// Names, and the values that they stand for.
template <class T>
using Choices = std::vector<std::pair<std::string, T>>;
extern const Choices<RenderMode> kRenderModes;

/// While it lives, options that are added to the command stand under this heading in --help.
class OptionGroup {
 public:
  OptionGroup(CLI::App& command, const std::string& heading)
      : defaults_(*command.option_defaults()), before_(defaults_.get_group()) {
    defaults_.group(heading);
  }
  OptionGroup(const OptionGroup&) = delete;
  OptionGroup& operator=(const OptionGroup&) = delete;
  ~OptionGroup() { defaults_.group(before_); }  // NOLINT(bugprone-exception-escape): out of memory

 private:
  CLI::OptionDefaults& defaults_;
  const std::string before_;
};

/// Makes an option accept these names only.
template <class T>
CLI::Option* choose(CLI::Option* option, const Choices<T>& choices) {
  std::vector<std::string> names;
  std::map<std::string, T> values;
  for (const auto& [name, value] : choices) names.push_back(name), values[name] = value;
  // CLI11 runs the check that was added last first.
  return option->transform(CLI::Transformer(std::move(values)).description(""))
      ->transform(CLI::IsMember(std::move(names)))
      ->type_name("TEXT")
      ->default_str("");
}

inline constexpr unsigned kMaxThreads = 1024;
inline constexpr std::int64_t kMaxPixels = 65536;  ///< along a side of a picture

/// Accept low <= number <= high, and low < number <= high. Neither accepts NaN.
[[nodiscard]] CLI::Validator from_to(double low, double high);
[[nodiscard]] CLI::Validator above(double low, double high);

extern const CLI::Validator kNotNegative;
extern const CLI::Validator kLength, kPlace;  ///< a length; a coordinate, or part of a direction

/// Adds an option for the path of a file or several, of one of the kinds above.
template <class T>
CLI::Option* add_file(CLI::App& command, const std::string& name, T& path, const std::string& help,
                      const char* kind = kAnyFile) {
  return command.add_option(name, path, help)->type_name(kind);
}
/// Adds an option for a number or several that pass the check.
template <class T>
CLI::Option* add_number(CLI::App& command, const std::string& name, T& number,
                        const std::string& help, const CLI::Validator& check) {
  return command.add_option(name, number, help)->check(check);
}

/// Adds -j,--threads.
CLI::Option* add_threads(CLI::App& command, unsigned& threads);

/// Adds --no-depth, which sets `depth` to false.
CLI::Option* add_no_depth(CLI::App& command, bool& depth, const std::string& help);

/// Adds an option for a number of bytes: "64MiB", "1.5G", "4096".
CLI::Option* add_bytes(CLI::App& command, const std::string& name, std::uint64_t& bytes,
                       const std::string& help);
/// Adds --memory to a command that writes a field.
CLI::Option* add_budget(CLI::App& command, std::uint64_t& memory);
/// Makes an option take so many numbers, with `delimiter` between them.
CLI::Option* of_numbers(CLI::Option* option, int count, char delimiter = ',');
/// Adds an option for three coordinates, "x,y,z". `vector` stays empty if it is not given.
CLI::Option* add_vector(CLI::App& command, const std::string& name, std::vector<double>& vector,
                        const std::string& help);
[[nodiscard]] glm::dvec3 to_vector(const std::vector<double>& numbers);

/// "512x384", or "512" for a square.
struct PixelSize {
  std::uint32_t width = 0, height = 0;
};
std::istream& operator>>(std::istream& in, PixelSize& size);
/// Makes an option take sizes, and name their bounds when it refuses one.
CLI::Option* of_pixels(CLI::Option* option);
/// Adds --size.
CLI::Option* add_size(CLI::App& command, PixelSize& size);
[[nodiscard]] std::string to_string(const PixelSize& size);

/// A range of levels of the tile pyramid, both ends inclusive: "2", "0-1".
struct LevelRange {
  unsigned first = 0, last = 0;
};
std::istream& operator>>(std::istream& in, LevelRange& range);
CLI::Option* add_levels(CLI::App& command, const std::string& name,
                        std::optional<LevelRange>& levels, const std::string& help);

/// Subfields of level 0, ascending: "0-7,12". Empty: not given.
struct Subfields {
  std::vector<std::uint8_t> numbers;
};
std::istream& operator>>(std::istream& in, Subfields& subfields);
CLI::Option* add_subfields(CLI::App& command, Subfields& subfields, const std::string& help);

/// Adds a hint to an error, such as the option to use. Libraries do not name options of the command
/// line.
[[nodiscard]] tl::unexpected<Error> with_hint(const Error& error, const std::string& hint);

/// Names -f in an error whose choice is to replace a file.
[[nodiscard]] Result<void> with_force(Result<void> checked);

/// check_output() for an option -f.
[[nodiscard]] Result<void> refuse_overwrite(const std::string& path, bool force,
                                            const std::vector<std::string>& inputs);

/// The inputs that are volumes.
inline const std::string kVolumeHelp =
    "Volume: " + volume_format_names() +
    " (also\nin gzip, bzip2, xz or zstd), a DICOM folder or one of its files, a folder of\n"
    "PNGs, JPEGs or TIFFs, or raw with --dims";
inline constexpr const char* kMeshHelp = "Mesh: .glb, .gltf, .obj, .ply, .stl";

/// The options of a recipe, which write to it.
struct SourceArguments : Recipe {
  std::string states_file;

  SourceArguments();

  /// Adds the input, as an option or positional `name`.
  void add_input_to(CLI::App& command, const char* name);
  /// Adds the options of the table that are `wanted`.
  void add_to(CLI::App& command, const std::function<bool(const recipe::Option&)>& wanted);
  /// Adds --states.
  void add_states_to(CLI::App& command);
  /// Reads the recipe that the input names, and the states, and sets what longer work needs.
  [[nodiscard]] Result<void> finish(unsigned threads, OnSignal on_signal);
};

/// The row of the table that an option of a command is made of; null: another option.
[[nodiscard]] const recipe::Option* row_of(const CLI::Option& option);

/// Makes `work` with its arguments what the command runs. Returns the command, and the arguments,
/// to which its options write.
template <class Arguments>
std::pair<CLI::App*, std::shared_ptr<Arguments>> add_command(
    CLI::App& app, Run& run, const std::string& name, const std::string& help,
    Result<void> (*work)(const Arguments&)) {
  CLI::App* const command = app.add_subcommand(name, help);
  auto arguments = std::make_shared<Arguments>();
  command->callback([&run, arguments, work] { run = [=] { return work(*arguments); }; });
  return {command, std::move(arguments)};
}

/// "see --mask" and the like, for the member of Recipe or BuildOptions of this name.
[[nodiscard]] std::string hint_of(std::string_view choice);
/// The value, or the error with a hint at the option that settles it.
template <class T>
Result<T> hinted(Result<T> result) {
  if (!result && result.error().choice &&
      !std::string_view(result.error().choice).starts_with("replace"))
    return with_hint(result.error(), hint_of(result.error().choice));
  return result;
}

/// The heading of the options that choose the part of a field to build.
inline constexpr const char* kShardGroup = "Several machines";
/// These options.
struct ShardArguments {
  std::string shard;  // "K/N" or "auto"; empty: not given
  std::optional<LevelRange> levels;
  std::string coarser;

  void add_to(CLI::App& command);
  /// Prints a note that names the engine of "auto". usage: --shard is invalid, or no engine is
  /// found.
  [[nodiscard]] Result<ShardOptions> options() const;
};
/// The path with {K} and {N} replaced by the shard's numbers; K has as many digits as N.
[[nodiscard]] std::string name_of_part(std::string path, const ShardOptions& shard);

/// The options of the camera and the size of the picture.
struct CameraArguments {
  std::vector<double> eye, look_at, up;  // empty: not given
  std::vector<double> orbit{30, 20, 3};
  PixelSize size{512, 512};
  double fov = 0;  // 0: the sphere fills the picture

  void add_to(CLI::App& command);
  [[nodiscard]] Result<Camera> camera(const Sphere& sphere) const;
};
/// --orbit, of CameraArguments and of play.
CLI::Option* add_orbit(CLI::App& command, std::vector<double>& orbit, const std::string& help);

/// The options of drawing from a field.
struct DrawArguments {
  static constexpr unsigned kFinest = kMatchingLevel - 1;

  std::optional<RenderMode> mode;  // none: the field's default
  unsigned level = kFinest;        // or kMatchingLevel
  std::uint64_t memory = 256ull << 20;
  unsigned threads = 0;
  std::vector<std::string> structures;
  SourceArguments cut;  // of which the planes count
  std::string cap;      // empty: shaded, if the field has a reveal

  /// Adds all options but --mode and --level; before others that may be named --clip.
  void add_resources_to(CLI::App& command);
  void add_to(CLI::App& command);
  void add_structures_to(CLI::App& command);
  void add_cut_to(CLI::App& command);
  [[nodiscard]] RendererOptions renderer(const ViewOptions& view) const;
  /// The part of the memory that a cap has, if any.
  [[nodiscard]] std::uint64_t memory_of_cap() const { return memory / 4 * 3; }
  /// The files that are drawn from.
  [[nodiscard]] std::vector<std::string> inputs(const FieldArguments& field) const;
  /// The field, composed of the structures that are given, if any. Without any, and without a
  /// state, a field whose states are the structures of a label volume is composed of all.
  [[nodiscard]] Result<Field> open(const FieldArguments& field) const;
  /// The scene that --cap names for the planes; null: the cut is hollow, or there is none.
  [[nodiscard]] Result<std::shared_ptr<const Scene>> cap_of(const Field& field,
                                                            std::span<const ClipPlane> clip) const;
  /// Resolves --level auto for `camera`. Without a camera it stays kMatchingLevel.
  [[nodiscard]] Result<ViewOptions> view(const Field& field,
                                         std::optional<Camera> camera = {}) const;
};

}  // namespace slf::cli
