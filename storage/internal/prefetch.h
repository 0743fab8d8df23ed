// Prefetch: asks the kernel for what will be read, together instead of page by page.
//
// The map is for random access, so each page that is touched before it is in memory costs a whole
// trip to the disk. A disk serves many requests at once in little more time than one.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "storage/internal/cursor.h"
#include "storage/internal/pages.h"
#include "storage/internal/record.h"

namespace slf::storage::internal {

/// Parts of the map, collected to be advised about together.
class Advice {
 public:
  /// Adds the pages that some bytes of the map lie in.
  void add(ByteSpan bytes);

  /// Tells the kernel, with neighbouring pages merged, in the order of the file. `advice` is one of
  /// MADV_WILLNEED and MADV_DONTNEED. Forgets the parts.
  void give(int advice);

 private:
  struct Range {
    std::uintptr_t begin = 0;
    std::uintptr_t end = 0;
  };
  std::vector<Range> ranges_;
};

/// The pages of a record that hold its header and table, as far as the leaf tells; all of it where
/// that is a single tile. Empty where the entry holds no record.
[[nodiscard]] ByteSpan head_of(const Pages& pages, const TreePage& leaf, std::uint32_t index);

/// Fetches what finding some keys touches: the pages of the tree, one level after the other, and
/// the heads of the records. Waits for the tree's pages, not for the heads.
/// A hint only: damage is passed over, for whoever reads to find. Untrusted input is safe.
/// REQUIRES: the keys ascend.
void prefetch_records(const Pages& pages, const Tree& tree, std::span<const RecordKey> keys);

/// Fetches the heads of the records from a cursor's entry to the end of its leaf, but of no more
/// than the first that ends at or above `to`.
void prefetch_heads(const Pages& pages, const Cursor& at, TileKey to);

}  // namespace slf::storage::internal
