// The visible parts of a volume: empty space to skip, and the bounds. Private to source.
#pragma once

#include <optional>

#include "slf/shape.h"
#include "source/medium/ray_grid.h"

namespace slf {

/// Computes the grid's bricks, distances and visible box from its table and dims. Returns a sphere
/// from the middle of that box to the farthest visible cell. The sphere depends only on the volume
/// and the table. Without a visible cell: nothing, or, if it `may_be_empty`, as if the one in the
/// middle were visible.
[[nodiscard]] std::optional<Sphere> find_visible_space(const Volume& volume, RayGrid& grid,
                                                       bool may_be_empty = false);

/// A little more than the distance of a point to the farthest visible cell; 0 without one.
[[nodiscard]] double find_reach(const Volume& volume, const RayGrid& grid, const glm::dvec3& from);

}  // namespace slf
