// Builds a field from a scene: every tile of every level, in key order, on all cores.
//
// Memory stays within a budget, beside that of the scene, whatever the field's size. The build may
// be killed at any instant: the same call resumes it. Tile content depends only on the scene and
// the settings, never on the number of threads or on where a build was interrupted.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/progress.h"
#include "slf/scene.h"
#include "slf/shape.h"

namespace slf {

/// Which part of a field a build makes. All parts have the same codec tables. merge_fields() joins
/// them to one field: its tiles have the same bytes as if one build had made it, and its file those
/// of a merge of that alone.
struct ShardOptions {
  /// The tiles in key order are cut into `count` ranges with about equally many rays; the build
  /// makes range `index`, from 1. Counts can be mixed: 1/2 has the tiles of 1/4 and 2/4. Of several
  /// states, it makes the same range of each.
  std::uint32_t index = 1;
  std::uint32_t count = 1;
  /// Only tiles of these levels; none: all.
  std::optional<unsigned> first_level, last_level;
  /// Path of a finished part of the same field, with all tiles of levels 0 to L. The build then
  /// makes tiles of level L + 1, which a predictive codec predicts from those of level L. Empty:
  /// the build also makes the coarser tiles that it needs, and stores them in its own file.
  std::string coarser;
};

struct BuildOptions {
  FieldShape shape;  ///< a sphere of radius 0: bounds_of() the states
  std::string codec = "predictive:90";
  bool depth = true;                ///< depths beside the colours; predictive codecs need them
  bool half = false;                ///< colour as half floats, which jpeg cannot hold
  bool keep_light = false;          ///< Scene::light() of the first state, from the first commit on
  std::uint64_t memory = 0;         ///< bytes of tiles in progress and records not yet written; 0:
                                    ///< 256 MiB, or what the largest tile needs
  unsigned threads = 0;             ///< 0: all
  double commit_seconds = 5;        ///< between commits: the most work that a kill can lose
  bool replace = false;             ///< replace a file at the output's path, once all is built
  ShardOptions shard;               ///< by default, all tiles
  std::vector<std::byte> reveal{};  ///< encode()'s code of a reveal to keep (reveal.h)
};

struct BuildReport {
  std::uint64_t tiles = 0, resumed = 0;
  std::uint64_t memory = 0;  ///< the budget

  static constexpr const char* kPython = "BuildReport";
  void describe(auto& member) const {
    member("tiles", tiles, "built by this call");
    member("resumed", resumed, "built by earlier calls");
  }
};

/// A state of a field, and the scene that shows it.
struct FieldState {
  std::string name;
  const Scene* scene = nullptr;  ///< not null
  std::string recipe{};          ///< a JSON object for people, of how it was made; empty: none
};

/// A sphere around all that is visible in any state: the bounds of the first state if these hold
/// the others, else the smaller one of two, about its centre or about that of all bounds. REQUIRES:
/// a state.
[[nodiscard]] Sphere bounds_of(std::span<const FieldState> states);

/// Builds, or resumes, the field at `path`. Progress counts rays, approximately.
///
/// The field grows in PATH.unfinished and is renamed to PATH when it is complete. Until then a file
/// at `path` does not change. PATH.unfinished opens as a field, with the tiles that were committed.
/// If `path` is a symbolic link, the file it points to is written. A new file that replaces another
/// gets its permissions. What happens depends on what exists:
///
/// | at `path` | without `replace` | with `replace` |
/// |---|---|---|
/// | no file | builds, or resumes PATH.unfinished | the same |
/// | this field, complete | returns at once: nothing is left to do | as if there were no file |
/// | this field with tiles missing | builds them in place | as if there were no file |
/// | any other file | usage or bad_file | as if there were no file |
///
/// usage: a setting, the scene's bounds or its provenance is wrong; the sphere misses all that is
/// visible; another field is at `path`, or
/// unfinished beside it, even with `replace`; `path` or PATH.unfinished is one of the scene's
/// files. unsupported: a codec that cannot hold the samples (JPEG and half floats). io: disk full
/// or a write error; committed tiles stay, and the same call resumes. cancelled: the progress
/// callback stopped the build, which the same call resumes. busy: another process is writing the
/// field. failed: the scene threw an exception; another process has removed, renamed or replaced
/// the field.
[[nodiscard]] Result<BuildReport> build_field(const Scene& scene, const std::string& path,
                                              const BuildOptions& options,
                                              const ProgressCallback& progress = {});

/// The same with several states on one sphere. Tiles whose samples equal those of the same tile of
/// an earlier state are stored once. Keeps 16 bytes in memory of each tile that is to be built.
/// usage: no state, a state without a name, two with one.
[[nodiscard]] Result<BuildReport> build_field(std::span<const FieldState> states,
                                              const std::string& path, const BuildOptions& options,
                                              const ProgressCallback& progress = {});

/// What a build would make, and how long it would take on as many threads.
struct BuildForecast {
  std::uint64_t tiles = 0, sampled = 0, rays = 0;
  double seconds = 0;
  std::uint64_t file_bytes = 0, file_error_bytes = 0;

  void describe(auto& member) const {
    member("tiles", tiles, "stored, empty or the same as others");
    member("tiles_sampled", sampled, "of them, made to estimate the others");
    member("rays", rays, "approximately");
    member("seconds", seconds, "estimate, on as many threads; reading the input is not in it");
    member("file_bytes", file_bytes, "estimate");
    member("file_error_bytes", file_error_bytes, "half of a 95 % confidence interval");
  }
};

/// Makes a sample of the tiles of each level, and writes nothing. Takes the light, the training of
/// the codec, and the rays of the sampled tiles and of those that some of them are predicted from:
/// about half as long as the build of a draft, a small part of that of a large field. Parts of
/// fields (BuildOptions::shard) are not regarded. Progress counts sampled tiles. Errors as
/// build_field(), except those of files.
[[nodiscard]] Result<BuildForecast> forecast_build(std::span<const FieldState> states,
                                                   const BuildOptions& options,
                                                   const ProgressCallback& progress = {});

/// Sets the reveal that a field keeps; no code: removes it. Errors as those of writing fields.
[[nodiscard]] Result<void> set_reveal(const std::string& path, std::span<const std::byte> code);

}  // namespace slf
