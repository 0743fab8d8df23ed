// RangeSet: a set of byte positions, stored as disjoint ranges.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "storage/tile_store.h"

namespace slf::storage::internal {

class RangeSet {
 public:
  void add(FileRange range);

  /// Appends the parts of `range` that are not in the set, ascending.
  void append_missing(FileRange range, std::vector<FileRange>& to) const;
  /// Whether all of `range` is in the set, or any byte of it.
  [[nodiscard]] bool contains(FileRange range) const;
  [[nodiscard]] bool intersects(FileRange range) const;

 private:
  std::map<std::uint64_t, std::uint64_t> ranges_;  // begin → end; no two meet
};

/// Ascending ranges that cover all of `ranges`. Gaps of up to `gap` bytes are filled. If more than
/// `max_ranges` ranges remain, the smallest other gaps are filled, too, but none of more than
/// `widest` bytes.
[[nodiscard]] std::vector<FileRange> merged(std::vector<FileRange> ranges, std::uint64_t gap,
                                            std::size_t max_ranges = ~std::size_t{0},
                                            std::uint64_t widest = ~std::uint64_t{0});

}  // namespace slf::storage::internal
