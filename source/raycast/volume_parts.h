// The parts of a volume as rows of its table. Private to source/raycast.
#pragma once

#include "slf/volume_parts.h"
#include "source/raycast/raycaster_kernel.h"

namespace slf {

struct SharedScenes;

/// The row of the table that each voxel uses.
struct PartRows {
  std::vector<std::uint8_t> rows;
  std::vector<double> ids;  ///< of the labels that have rows, from row 1 on
};

/// Adds a row for each part to the grid's table, and sets the row of each voxel. Looks for rows of
/// the same volumes in `shared`, which may be null, and keeps them there: `content` tells volumes
/// apart. usage: labels or mask do not overlap the volume. unsupported: more than 254 different
/// labels. Needs no memory beyond the rows.
[[nodiscard]] Result<void> add_parts(const VolumeParts& parts, const Volume& volume,
                                     const std::string& content, SharedScenes* shared,
                                     RayGrid& grid);

}  // namespace slf
