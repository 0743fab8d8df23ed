// MergePlan: which tiles of a merged field come from which part.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/geometry/tile_selection.h"
#include "slf/error.h"

namespace slf {

/// Consecutive tiles of the merged field that come from one part.
struct MergeSegment {
  NumberRange tiles;       ///< by their numbers in the merged field
  std::size_t source = 0;  ///< index of the part
};

struct MergePlan {
  Manifest manifest;                   ///< of the merged field
  Bytes tables;                        ///< of its codec
  KeptBlobs kept;                      ///< each of the first part that has it
  std::vector<std::uint64_t> commits;  ///< of each part: the number of the commit that was read
  std::vector<MergeSegment> segments;  ///< in key order, without gaps
};

/// Opens the parts one after the other, and compares them. `part`: the merged field may be a part.
/// Errors as merge_fields().
[[nodiscard]] Result<MergePlan> plan_merge(const std::vector<std::string>& paths, bool part);

}  // namespace slf
