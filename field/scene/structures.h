// The structures of a volume as rows of its table. Private to this room.
#pragma once

#include "field/scene/raycaster_kernel.h"
#include "slf/structures.h"

namespace slf {

/// Adds a row for each structure to the grid's table, and says which voxel uses which.
/// `steps_per_unit` is that of the table. usage: labels or mask of other dimensions or at another
/// place than the volume. unsupported: labels that differ in more than 254 ways.
[[nodiscard]] Result<void> add_structures(const Structures& structures, const Volume& volume,
                                          double steps_per_unit, RayGrid& grid);

}  // namespace slf
