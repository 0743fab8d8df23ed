// What of a volume can be seen: empty space to leap over, and the bounds. Private to field/.
#pragma once

#include <optional>

#include "field/scene/raycaster_kernel.h"

namespace slf {

/// Fills the grid's bricks, distances and visible box from its table and dims, and returns a sphere
/// around all visible cells; nothing when there are none. The sphere depends on the volume and the
/// table alone.
[[nodiscard]] std::optional<Sphere> find_visible_space(const Volume& volume, RayGrid& grid);

}  // namespace slf
