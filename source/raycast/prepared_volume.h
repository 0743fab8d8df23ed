// PreparedVolume: a volume, its transfer function and its light, ready for rays. Private to
// source/raycast.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "slf/raycaster.h"
#include "slf/volume_parts.h"
#include "source/raycast/raycaster_kernel.h"

namespace slf {

/// Voxels in a type of RayGrid, and what is known of them.
struct RayVoxels {
  std::shared_ptr<const std::byte> bytes{};
  ScalarType type = ScalarType::u8;
  double intercept = 0;
  std::vector<double> labels{};  ///< of a volume of labels: the id that each number stands for
  std::array<float, 2> range{};  ///< of amounts: the least and greatest finite one, as stored
  bool finite = true;            ///< whether there is one
};

/// The row of the table that each voxel uses.
struct PartRows {
  std::vector<std::uint8_t> rows;
  std::vector<double> ids;  ///< of the labels that have rows, from row 1 on
};

struct LitScene;

/// RaycastOptions::shared. The keys tell all apart that the values depend on.
struct SharedScenes {
  std::map<std::string, RayVoxels> voxels{};
  std::map<std::string, std::shared_ptr<const PartRows>> rows{};
  std::map<std::string, std::shared_ptr<LitScene>> lit{};  ///< of which scenes show some labels
};

/// Adds a row for each part to the grid's table, and sets the row of each voxel. Looks for rows of
/// the same volumes in `shared`, which may be null, and keeps them there: `content` tells volumes
/// apart. usage: labels or mask do not overlap the volume. unsupported: more than 254 different
/// labels. Needs no memory beyond the rows.
[[nodiscard]] Result<void> add_parts(const VolumeParts& parts, const Volume& volume,
                                     const std::string& content, SharedScenes* shared,
                                     RayGrid& grid);

/// The data that ray-caster and path tracer share. The grid points into the volume.
struct PreparedVolume {
  Volume volume;
  RayGrid grid;
  Sphere bounds;
  LightOptions lighting;
  std::string provenance;
  std::vector<double> labels{};  ///< of a volume of labels: RayVoxels::labels
};

/// Converts the voxels, makes the tables and finds the visible space, on `threads` threads (0:
/// all); no light volume yet. Errors as Raycaster::make.
[[nodiscard]] Result<std::unique_ptr<PreparedVolume>> prepare_volume(
    Volume volume, const TransferFunction& transfer, const RaycastOptions& options,
    unsigned threads = 0);

}  // namespace slf
