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

  /// Appends the parts of `range` that are not in the set, ascending.
  void lacks(FileRange range, std::vector<FileRange>& to) const;
  /// Whether all of `range` is in the set, or any byte of it.
  [[nodiscard]] bool has(FileRange range) const;
  [[nodiscard]] bool touches(FileRange range) const;

 private:
  std::map<std::uint64_t, std::uint64_t> ranges_;  // begin → end; no two meet
};

/// Ascending ranges that cover all of `ranges`: gaps of up to `gap` bytes are filled and, if more
/// than `most` ranges are left, the smallest of the other gaps of up to `widest` bytes, too.
[[nodiscard]] std::vector<FileRange> merged(std::vector<FileRange> ranges, std::uint64_t gap,
                                            std::size_t most,
                                            std::uint64_t widest = ~std::uint64_t{0});

}  // namespace slf::storage::internal
