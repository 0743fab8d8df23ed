// ByteSource: a container whose bytes are not mapped, such as ranges that come over HTTP.
#pragma once

#include <cstdint>
#include <span>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/tile_store.h"

namespace slf::storage::internal {

/// Thread-safety: as of the implementation.
class ByteSource {
 public:
  virtual ~ByteSource() = default;

  /// `size` bytes at `offset`, valid as long as the source. io: they are not there, or not yet.
  /// REQUIRES: the range is inside the snapshot's pages.
  [[nodiscard]] virtual Result<ByteSpan> bytes(std::uint64_t offset, std::uint64_t size) const = 0;

  /// All of the file, if it is contiguous in memory; what bytes() has not returned is undefined.
  [[nodiscard]] virtual ByteSpan file() const { return {}; }

  /// Says that bytes() will be called for these ranges, so that they come together. A hint.
  virtual void expect(std::span<const FileRange> /*ranges*/) const {}
};

}  // namespace slf::storage::internal
