// The depths below the surface of a light volume's nodes. Private to source.
#pragma once

#include <vector>

#include "slf/error.h"
#include "source/light/light_grid.h"
#include "source/medium/medium.h"

namespace slf {

/// Optical depth from which matter cannot be seen: less than 0.1 % of its light leaves.
inline constexpr float kHidden = 7;

/// Mean extinction around each node of a grid, per world unit. Errors as parallel_for().
[[nodiscard]] Result<std::vector<float>> node_extinctions(const Medium& medium,
                                                          const LightGrid& light, unsigned threads);

/// For each node, given their extinctions, the smallest optical depth of a path along the grid to
/// the outside. It estimates that of straight lines. If it exceeds kHidden, no view shows the node.
[[nodiscard]] std::vector<float> depth_from_outside(const Medium& medium, const LightGrid& light,
                                                    const std::vector<float>& extinction);

/// For each node, given their extinctions, the share of light from outside that reaches it
/// straight, of 26 directions along the grid.
[[nodiscard]] std::vector<float> openness(const Medium& medium, const LightGrid& light,
                                          const std::vector<float>& extinction);

/// Whether anything whose light rays look up at a node can be visible.
[[nodiscard]] bool near_matter(const RayGrid& grid, const LightGrid& light, const glm::ivec3& node);

}  // namespace slf
