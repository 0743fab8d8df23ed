#include "field/render/depth_refinement.h"

#include <limits>
#include <utility>

#include "field/render/ray_kernel.h"

namespace slf {
namespace {

/// A ray has converged when its aims move, along the chord, by no more than this times the entry
/// lattice's resolution. The closer the vertices, the less an aim moves the exit points.
constexpr float kConvergence = 1.f / 4096;
constexpr int kMaxRounds = 3;

/// From this contrast on, a cubic makes a difference.
constexpr float kContrast = 0.1f;

/// Pass::depth_tolerance in steps of the exit lattice: on slanted surfaces neighbouring samples
/// differ in depth, too.
constexpr float kDepthTolerance = 6.4f;

float convergence(const LevelGeometry& geometry) {
  return kConvergence * static_cast<float>(geometry.entry_resolution());
}

}  // namespace

void DepthRefinement::begin(const LevelGeometry& geometry, Pass& pass) {
  rounds_ = 0;
  contrast_rays_.count = 0;
  pass.depth_tolerance = kDepthTolerance / static_cast<float>(geometry.exit_resolution());
  for (std::size_t c = 0; c < 3; ++c) {
    pass.exit_point[c] = &exit_points_[c];
    pass.exit[c] = &exits_[c];
  }
}

bool DepthRefinement::next_pass(const LevelGeometry& geometry, RayBlock& rays, EntryCells& entries,
                                Pass& pass) {
  if (pass.cubic) return false;
  const std::size_t before = rays.count;
  const bool end = rounds_++ == kMaxRounds;
  separate_rays(end ? std::numeric_limits<float>::infinity() : convergence(geometry), kContrast,
                rays, estimates_, contrast_rays_, contrast_estimates_);
  if (rounds_ == kMaxRounds) pass.mean_above = convergence(geometry);
  if (rays.count == 0) {
    std::swap(rays, contrast_rays_);
    std::swap(estimates_, contrast_estimates_);
    pass.cubic = true;
  }
  if (rays.count == 0) return false;
  if (pass.cubic || rays.count < before) locate_entries(geometry, rays, false, true, entries);
  aim_at_depth(rays, entries, estimates_, exit_points_);
  for (std::size_t c = 0; c < 3; ++c)
    locate_exits(geometry, exit_points_[c], rays.count, pass.cubic ? ExitUse::cubic : ExitUse::all,
                 exits_[c]);
  return true;
}

}  // namespace slf
