// Builds a field from a scene: every tile of every level, in key order, on all cores.
//
// Memory is bounded by a few tiles per thread, whatever the field's size. The build may be killed
// at any instant: the same call resumes it. Tile content depends only on the scene and the
// settings, never on the number of threads or on where a build was interrupted.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "slf/error.h"
#include "slf/scene.h"
#include "slf/shape.h"

namespace slf {

struct BuildOptions {
  FieldShape shape;  ///< sphere.radius <= 0: the scene's own bounds
  std::string color_codec = "jpeg:90";
  std::string depth_codec = "jpeg:75";  ///< empty: no depth layer
  bool half = false;                    ///< colour as half floats, with zstd or raw
  unsigned threads = 0;                 ///< 0: all
  double commit_seconds = 1;            ///< how often tiles are made safe: what a kill can cost
};

struct Progress {
  std::uint64_t done = 0;  ///< work finished; of what, each function says
  std::uint64_t total = 0;
  std::uint64_t skipped = 0;  ///< of done: already there when this run began
};
/// Called from the calling thread now and then, and at the end. Returning false stops the work
/// after what is under way; what was committed stays.
using ProgressCallback = std::function<bool(const Progress&)>;

struct BuildReport {
  std::uint64_t tiles = 0;    ///< built by this run
  std::uint64_t resumed = 0;  ///< that were there already
};

/// Builds, or resumes, the field at `path`. Progress counts rays, about.
/// usage: a setting out of range; a complete field, or another one, is at `path`.
/// unsupported: a codec that cannot hold the samples (JPEG and half floats). io: disk full or a
/// write error: what was committed stays and the same call resumes. failed: stopped by the progress
/// callback, or another process is writing the file.
[[nodiscard]] Result<BuildReport> build_field(const Scene& scene, const std::string& path,
                                              const BuildOptions& options,
                                              const ProgressCallback& progress = {});

}  // namespace slf
