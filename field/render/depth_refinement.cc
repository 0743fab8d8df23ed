#include "field/render/depth_refinement.h"

#include "field/render/ray_kernel.h"
#include "field/render/refine_kernel.h"

namespace slf {
namespace {

/// A ray has converged when its aims move, along the chord, by no more than this times the entry
/// lattice's resolution. The closer the vertices, the less an aim moves the exit points.
constexpr float kConvergence = 1.f / 2048;
constexpr int kMaxRounds = 3;

/// Pass::depth_tolerance in steps of the exit lattice: on slanted surfaces neighbouring samples
/// differ in depth, too.
constexpr float kDepthTolerance = 6.4f;

}  // namespace

void DepthRefinement::resize(std::size_t rays) {
  estimates_.resize(rays);
  for (auto& points : exit_points_) points.resize(rays + kRayPadding);
  for (auto& exits : exits_) exits.resize(rays);
}

void DepthRefinement::begin(const LevelGeometry& geometry, Pass& pass) {
  rounds_ = 0;
  pass.depth_tolerance = kDepthTolerance / static_cast<float>(geometry.exit_resolution());
  for (std::size_t c = 0; c < 3; ++c) {
    pass.aim[c] = &exit_points_[c];
    pass.exit[c] = &exits_[c];
  }
}

bool DepthRefinement::next_round(const LevelGeometry& geometry, RayBlock& rays,
                                 EntryCells& entries) {
  if (rounds_++ == kMaxRounds) return false;
  const std::size_t before = rays.count;
  compact_unconverged(kConvergence * static_cast<float>(geometry.entry_resolution()), rays,
                      estimates_);
  if (rays.count == 0) return false;
  if (rays.count < before) locate_entries(geometry, rays, false, true, entries);
  aim_at_depth(rays, entries, estimates_, exit_points_);
  for (std::size_t c = 0; c < 3; ++c)
    locate_exits(geometry, exit_points_[c], rays.count, false, exits_[c]);
  return true;
}

}  // namespace slf
