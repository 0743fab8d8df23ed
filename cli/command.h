// What the commands of `slf` share: how they run, what they say, and options several of them take.
//
// Data goes to stdout, progress and messages to stderr. The exit code is the ErrorCode of the
// failure, 0 on success.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "slf/build.h"
#include "slf/camera.h"
#include "slf/error.h"
#include "slf/field.h"
#include "slf/raycaster.h"
#include "slf/render.h"
#include "slf/scene.h"

namespace slf::cli {

/// What is to be done once the command line is parsed. A subcommand's callback sets it.
using Run = std::function<Result<void>()>;

/// The command line of `slf` with all of its commands. Parsing sets `run`, which must outlive it.
[[nodiscard]] std::unique_ptr<CLI::App> make_app(Run& run);

void add_build(CLI::App& app, Run& run);
void add_info(CLI::App& app, Run& run);
void add_render(CLI::App& app, Run& run);
void add_raycast(CLI::App& app, Run& run);
void add_compare(CLI::App& app, Run& run);
void add_play(CLI::App& app, Run& run);
void add_measure(CLI::App& app, Run& run);
void add_evaluate(CLI::App& app, Run& run);
void add_repack(CLI::App& app, Run& run);
void add_verify(CLI::App& app, Run& run);

/// --quiet: no progress, no notes; set from main.
extern bool quiet;

/// Set by SIGINT and SIGTERM: finish what is under way, commit, and stop.
[[nodiscard]] bool interrupted();
void watch_signals();

/// A line for people, on stderr, unless quiet.
void note(const std::string& text);

/// JSON on stdout.
void print_json(const nlohmann::json& json);

/// A text member of untrusted JSON, or `otherwise`.
[[nodiscard]] std::string text_of(const nlohmann::json& json, const char* key,
                                  const std::string& otherwise);

/// "1.5 GiB", "12.3 M".
[[nodiscard]] std::string human_bytes(double bytes);
[[nodiscard]] std::string human_count(double count);

/// Rows of cells, the first row the heading, columns aligned right but for the first.
void print_table(const std::vector<std::vector<std::string>>& rows);

/// A bar with rate and time left on stderr, when that is a terminal; counts `unit`s.
[[nodiscard]] ProgressCallback progress_bar(const std::string& title, const std::string& unit);

// ---- arguments -------------------------------------------------------------------------------

/// "64MiB", "1.5G", "4096".
[[nodiscard]] Result<std::uint64_t> parse_bytes(const std::string& text, const char* option);
/// "x,y,z".
[[nodiscard]] Result<glm::dvec3> parse_vec3(const std::string& text, const char* option);
/// Refuses an existing output without -f: usage.
[[nodiscard]] Result<void> refuse_overwrite(const std::string& path, bool force);

/// What arguments hold: shown by --help, and what completion in a shell goes by.
inline constexpr const char* kFieldFile = "FILE.slf";
inline constexpr const char* kAnyFile = "FILE";
inline constexpr const char* kFolder = "DIR";
inline constexpr const char* kCodec = "CODEC";
inline constexpr const char* kVoxelType = "TYPE";
inline constexpr std::initializer_list<const char*> kRenderModes{"nearest", "uv", "st", "bitri",
                                                                 "depth"};

/// The inputs that are volumes.
inline constexpr const char* kVolumeHelp =
    "Volume: NIfTI, NRRD, MetaImage, a DICOM folder or one of its files,\nor raw with --dims";
inline constexpr const char* kVolumeGroup = "Volume";

/// INPUT: a volume with its transfer function, or scene:NAME; and how it is lit.
struct SourceArguments {
  std::string input;
  std::string transfer;
  std::string dims, type = "u8", spacing = "1x1x1", endian = "little";
  std::uint64_t offset = 0;
  bool labels = false;
  RaycastOptions raycast;
  std::string light;
  bool no_shade = false;

  /// The volume and its transfer function, as an option or positional of that name.
  void add_volume_to(CLI::App& command, const char* name);
  /// Of them, what says how voxels are to be read.
  void add_raw_to(CLI::App& command);
  /// Step, light and shading.
  void add_light_to(CLI::App& command);
  [[nodiscard]] Result<Volume> volume() const;
  /// What is not given is taken from `provenance`, that of a field, or set to the defaults.
  [[nodiscard]] Result<std::unique_ptr<Scene>> scene(
      const std::optional<std::string>& provenance = {}) const;
};

/// Where to look from, and the size of the picture.
struct CameraArguments {
  std::string eye, look_at, up, orbit = "30,20,3", size = "512x512";
  double fov = 0;

  void add_to(CLI::App& command);
  [[nodiscard]] Result<Camera> camera(const Sphere& sphere) const;
};
[[nodiscard]] Result<std::pair<std::uint32_t, std::uint32_t>> parse_size(const std::string& text);

/// How to draw from a field.
struct DrawArguments {
  std::string mode;  // empty: the field's default
  std::string level = "finest";
  std::string memory = "256MiB";
  std::string map_budget;  // empty: no limit
  unsigned threads = 0;

  void add_to(CLI::App& command);
  [[nodiscard]] Result<RendererOptions> renderer() const;
  /// `camera` resolves --level auto; without one it stays kMatchingLevel.
  [[nodiscard]] Result<ViewOptions> view(const Field& field,
                                         std::optional<Camera> camera = {}) const;
};

}  // namespace slf::cli
