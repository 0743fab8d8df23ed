// DepthRefinement: the further passes of mode depth (FORMAT.md, "Mode depth"). Private to
// field/render.
//
// The first pass samples where each ray itself leaves the sphere and estimates how deep along the
// ray something is. Each round then aims the ray's entry vertices at that point and samples again,
// which refines the estimate; rays drop out as their estimates converge.
#pragma once

#include <array>

#include "field/geometry/level_geometry.h"
#include "field/render/ray_block.h"

namespace slf {

/// Reused from block to block. Thread-safety: one thread.
class DepthRefinement {
 public:
  void resize(std::size_t rays);

  /// What blend() of each pass writes.
  [[nodiscard]] DepthEstimates& estimates() { return estimates_; }

  /// Begins with the estimates of a first pass, and makes it the pass of every round.
  void begin(const LevelGeometry& geometry, Pass& pass);

  /// Prepares the next round: compacts the block to the rays that have not converged, aims their
  /// entry vertices and locates the cells there. False when no ray or round is left.
  [[nodiscard]] bool next_round(const LevelGeometry& geometry, RayBlock& rays, EntryCells& entries);

 private:
  int rounds_ = 0;
  DepthEstimates estimates_;
  std::array<PointArrays, 3> exit_points_;
  std::array<ExitCells, 3> exits_;
};

}  // namespace slf
