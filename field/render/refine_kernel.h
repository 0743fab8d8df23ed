// The arithmetic of depth refinement (depth_refinement.h), compiled for several instruction sets.
// Private to field/render.
#pragma once

#include <array>

#include "field/render/ray_block.h"

namespace slf {

/// Compacts `rays` and `estimates` to the rays whose step exceeds `threshold`, and sets their aims
/// to those of the next round. Of the other rays, appends those with at least this contrast to
/// `contrast_rays` and `contrast_estimates`, with their last aims. The entry cells of all must then
/// be located again.
void separate_rays(float threshold, float contrast, RayBlock& rays, DepthEstimates& estimates,
                   RayBlock& contrast_rays, DepthEstimates& contrast_estimates);

/// Aims each entry vertex at the ray's point at the depth `estimates.aim`. Sets `exits` to the
/// points where the lines from the vertices through these points leave the sphere.
void aim_at_depth(const RayBlock& rays, const EntryCells& entries, const DepthEstimates& estimates,
                  std::array<PointArrays, 3>& exits);

}  // namespace slf
