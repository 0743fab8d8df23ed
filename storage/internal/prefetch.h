// Prefetch: asks the kernel for pages in batches before they are read.
//
// The map has no readahead, so each page that is not in memory costs one round trip to the disk. A
// disk serves many requests at once in little more time than one.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "storage/internal/cursor.h"
#include "storage/internal/pages.h"
#include "storage/internal/record.h"

namespace slf::storage::internal {

/// Collects parts of the file for one batch of madvise() calls, or of requests to its source.
class Advice {
 public:
  explicit Advice(const Pages& pages) : pages_(pages) {}

  /// Adds some bytes of pages.file().
  void add(ByteSpan bytes);

  /// Advises the kernel about the collected pages, in file order and with neighbouring pages
  /// merged, and clears the collection. `advice` is MADV_WILLNEED or MADV_DONTNEED.
  void apply(int advice);

 private:
  void expect();

  const Pages& pages_;
  std::vector<FileRange> ranges_;  // addresses
};

/// The bytes of a record that hold its header and table, estimated from the leaf alone; the whole
/// record if it has a single tile; empty if the entry is not a record.
[[nodiscard]] ByteSpan record_head(const Pages& pages, const TreePage& leaf, std::uint32_t index);

/// Fetches the pages that a search for some keys reads: the tree level by level, then the heads of
/// the records. Waits for the tree's pages but not for the heads.
/// A hint only: skips damage, which the search itself reports. Untrusted input is safe.
/// REQUIRES: the keys ascend.
void prefetch_records(const Pages& pages, const Tree& tree, std::span<const RecordKey> keys);

/// Fetches the heads of the records from a cursor's entry on: to the end of its leaf, or to the
/// first record that ends at or above `to`.
void prefetch_heads(const Pages& pages, const Cursor& at, TileKey to);

}  // namespace slf::storage::internal
