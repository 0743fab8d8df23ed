// The visible parts of a volume: empty space to skip, and the bounds. Private to field/scene.
#pragma once

#include <optional>

#include "field/scene/raycaster_kernel.h"

namespace slf {

/// Computes the grid's bricks, distances and visible box from its table and dims. Returns a sphere
/// around all visible cells, or nothing if there are none. The sphere depends only on the volume
/// and the table.
[[nodiscard]] std::optional<Sphere> find_visible_space(const Volume& volume, RayGrid& grid);

/// How far from a world point the farthest visible cell reaches.
[[nodiscard]] double farthest_visible(const Volume& volume, const RayGrid& grid,
                                      const glm::dvec3& from);

}  // namespace slf
