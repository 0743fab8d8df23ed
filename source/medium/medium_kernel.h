// Extinction along a ray, compiled for several instruction sets. Private to source.
#pragma once

#include <array>
#include <glm/glm.hpp>
#include <vector>

#include "source/medium/ray_grid.h"

namespace slf {

/// Extinctions at successive places.
using March = std::array<float, 8>;

/// Those at from, from + step, …, from `extinctions`, one for each entry of the grid's table.
/// Places are clamped to the volume. REQUIRES: the grid has no labels and no structures, and its
/// table is not logarithmic.
void march(const RayGrid& grid, const std::vector<float>& extinctions, const glm::vec3& from,
           const glm::vec3& step, March& to);

}  // namespace slf
