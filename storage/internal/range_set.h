// RangeSet: a set of bytes, as disjoint ranges.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "storage/tile_store.h"

namespace slf::storage::internal {

class RangeSet {
 public:
  void add(FileRange range);
  void remove(FileRange range);

  /// Appends the parts of `range` that the set does not have, ascending.
  void lacks(FileRange range, std::vector<FileRange>& to) const;
  [[nodiscard]] bool has(FileRange range) const;
  [[nodiscard]] bool touches(FileRange range) const;

 private:
  std::map<std::uint64_t, std::uint64_t> ranges_;  // begin → end; no two meet
};

/// The fewest ranges, ascending, that hold all of `ranges` when gaps of up to `gap` bytes are
/// filled; and when more than `most` are left, the smallest of the other gaps.
[[nodiscard]] std::vector<FileRange> merged(std::vector<FileRange> ranges, std::uint64_t gap,
                                            std::size_t most);

}  // namespace slf::storage::internal
