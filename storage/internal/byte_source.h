// ByteSource: where Pages reads a container that is not mapped. SparseCopy and RangedStore are two:
// one fetches bytes when they are read, the other reports those that it lacks.
#pragma once

#include <cstdint>
#include <span>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/tile_store.h"

namespace slf::storage::internal {

/// Thread-safety: the implementation states it.
class ByteSource {
 public:
  virtual ~ByteSource() = default;

  /// `size` bytes at `offset`, valid as long as the source. io: they cannot be read, or are not
  /// present yet.
  /// REQUIRES: the range is inside the snapshot's pages.
  [[nodiscard]] virtual Result<ByteSpan> bytes(std::uint64_t offset, std::uint64_t size) const = 0;

  /// The whole file, if it is contiguous in memory; empty otherwise. Only ranges that bytes() has
  /// returned have defined content.
  [[nodiscard]] virtual ByteSpan file() const { return {}; }

  /// A hint that bytes() will be called for these ranges, so that they can be fetched together.
  virtual void expect(std::span<const FileRange> /*ranges*/) const {}
};

}  // namespace slf::storage::internal
