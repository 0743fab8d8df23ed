// Builds a field from a scene: every tile of every level, in key order, on all cores.
//
// Memory is bounded by a few tiles per thread, whatever the field's size. The build may be killed
// at any instant: the same call resumes it. Tile content depends only on the scene and the
// settings, never on the number of threads or on where a build was interrupted.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "slf/error.h"
#include "slf/progress.h"
#include "slf/scene.h"
#include "slf/shape.h"

namespace slf {

/// Which part of a field a build makes. All parts have the same codec tables, and merge_fields()
/// joins them to the field that one build makes.
struct ShardOptions {
  /// The index-th (from 1) of `count` ranges of tiles, in key order, of about equally many rays.
  /// Ranges of any counts go together: 1/2 is 1/4 and 2/4.
  std::uint32_t index = 1;
  std::uint32_t count = 1;
  /// Only tiles of these levels; none: all.
  std::optional<unsigned> first_level, last_level;
  /// A predictive codec predicts tiles from those of the next coarser level. This part of the same
  /// field, levels 0 to some level, has them: the level behind it is built. Empty: the tiles that
  /// are needed are built, too, and stored in the part's file.
  std::string coarser;
};

struct BuildOptions {
  FieldShape shape;  ///< a sphere of radius 0: the scene's own bounds
  /// "predictive:QUALITY" codes colour together with depth; other codecs code colour alone.
  std::string color_codec = "predictive:90";
  std::string depth_codec;    ///< empty: none, or together with colour
  bool half = false;          ///< colour as half floats, with zstd or raw
  unsigned threads = 0;       ///< 0: all
  double commit_seconds = 5;  ///< how often tiles are made safe: what a kill can cost
  bool replace = false;       ///< what is at the output's path, when all is built
  ShardOptions shard;         ///< by default, all tiles
};

struct BuildReport {
  std::uint64_t tiles = 0;    ///< built by this run
  std::uint64_t resumed = 0;  ///< that were there already; all of them if the field was complete
};

/// Builds, or resumes, the field at `path`. Progress counts rays, about.
///
/// The field grows in PATH.unfinished and takes its name when it is complete. Until then whatever
/// is at `path` stays as it is. PATH.unfinished is a field too: it opens, and shows what was
/// committed. A symbolic link at `path` is written through; a file that is replaced passes its
/// permissions on. Depending on what is there:
///
/// | at `path` | without `replace` | with `replace` |
/// |---|---|---|
/// | nothing | builds, or resumes PATH.unfinished | the same, or starts over if it differs |
/// | this field, complete | returns at once: nothing is left to do | as with nothing |
/// | this field with tiles missing | fills them in place | as with nothing |
/// | anything else | usage or bad_file | as with nothing |
///
/// usage: a setting, the scene's bounds or its provenance is wrong; another field is at `path` or
/// unfinished beside it; `path` is one of the scene's files. unsupported: a codec that cannot hold
/// the samples (JPEG and half floats). io: disk full or a write error: what was committed stays and
/// the same call resumes. failed: stopped by the progress callback; the scene throws an exception;
/// another process is writing the field, or has removed, renamed or replaced it meanwhile.
[[nodiscard]] Result<BuildReport> build_field(const Scene& scene, const std::string& path,
                                              const BuildOptions& options,
                                              const ProgressCallback& progress = {});

}  // namespace slf
