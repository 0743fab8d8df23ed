// DepthRefinement: the further passes of mode depth (doc/drawing.md, "Mode depth"). Private to
// field/render.
//
// The first pass samples all entry vertices at the ray's own exit point, and estimates the depth
// along the ray. Each round then aims the entry vertices at the point at this depth and samples
// again, which improves the estimate. Rays whose aims have converged are removed from the block.
// Last comes a cubic pass over all rays that ended between samples of different colours.
#pragma once

#include <array>

#include "field/geometry/level_geometry.h"
#include "field/render/ray_block.h"

namespace slf {

/// Reused from block to block. Thread-safety: one thread.
class DepthRefinement {
 public:
  /// The estimates that blend() writes in each pass.
  [[nodiscard]] DepthEstimates& estimates() { return estimates_; }

  /// Begins with the estimates of the first pass, and changes `pass` to that of the rounds.
  void begin(const LevelGeometry& geometry, Pass& pass);

  /// Prepares the next round, or the cubic pass: sets the block to its rays, aims their entry
  /// vertices and locates the cells there. Returns false when no pass is left.
  [[nodiscard]] bool next_pass(const LevelGeometry& geometry, RayBlock& rays, EntryCells& entries,
                               Pass& pass);

 private:
  int rounds_ = 0;
  DepthEstimates estimates_;
  RayBlock contrast_rays_;  // that have ended, for the cubic pass
  DepthEstimates contrast_estimates_;
  std::array<PointArrays, 3> exit_points_;
  std::array<ExitCells, 3> exits_;
};

}  // namespace slf
