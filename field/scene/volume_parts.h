// The parts of a volume as rows of its table. Private to field/scene.
#pragma once

#include "field/scene/raycaster_kernel.h"
#include "slf/volume_parts.h"

namespace slf {

/// Adds a row for each part to the grid's table, and sets the row of each voxel.
/// usage: labels or mask do not overlap the volume. unsupported: more than 254 different labels.
/// Needs no memory beyond the rows.
[[nodiscard]] Result<void> add_parts(const VolumeParts& parts, const Volume& volume, RayGrid& grid);

}  // namespace slf
