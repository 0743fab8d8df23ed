// The structures of a volume as rows of its table. Private to field/scene.
#pragma once

#include "field/scene/raycaster_kernel.h"
#include "slf/structures.h"

namespace slf {

/// Adds a row for each structure to the grid's table, and sets the row of each voxel.
/// usage: labels or mask have other dimensions or another position than the volume. unsupported:
/// more than 254 different labels.
[[nodiscard]] Result<void> add_structures(const Structures& structures, const Volume& volume,
                                          RayGrid& grid);

}  // namespace slf
