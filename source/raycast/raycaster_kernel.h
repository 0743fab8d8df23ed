// The inner loop of the ray-caster, compiled for several instruction sets. Private to
// source/raycast.
#pragma once

#include <span>

#include "slf/raycaster.h"
#include "slf/scene.h"
#include "source/light/light_grid.h"
#include "source/medium/ray_grid.h"

namespace slf {

/// Traces each ray to one sample. Selects the best instruction set at run time. A ray's sample does
/// not depend on the other rays.
RayCounts trace_rays(const RayGrid& grid, std::span<const Segment> rays, std::span<RaySample> out);

}  // namespace slf
