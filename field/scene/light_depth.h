// How deep below the surface the nodes of a light volume lie. Private to this room.
#pragma once

#include <vector>

#include "field/scene/light_grid.h"
#include "field/scene/medium.h"

namespace slf {

/// Optical depth from which matter cannot be seen: less than 0.1 % of its light leaves.
inline constexpr float kHidden = 7;

/// Per node, the least optical depth of the paths along the grid to the outside: an estimate of
/// that of straight lines. Where it exceeds kHidden, no view shows the node.
[[nodiscard]] std::vector<float> depth_from_outside(const Medium& medium, const LightGrid& light);

/// Whether anything within one spacing of a node can be visible.
[[nodiscard]] bool near_matter(const RayGrid& grid, const LightGrid& light, const glm::ivec3& node);

/// Trilinear interpolation at a position in nodes, clamped to the grid.
[[nodiscard]] double interpolate(const LightGrid& light, const std::vector<float>& values,
                                 const glm::dvec3& at);

}  // namespace slf
