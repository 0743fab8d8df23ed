// ByteSource: a container whose bytes are not mapped, such as ranges that come over HTTP.
#pragma once

#include <cstdint>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf::storage::internal {

/// Thread-safety: as of the implementation.
class ByteSource {
 public:
  virtual ~ByteSource() = default;

  /// `size` bytes at `offset`, valid as long as the source. io: they are not there, or not yet.
  /// REQUIRES: the range is inside the snapshot's pages.
  [[nodiscard]] virtual Result<ByteSpan> bytes(std::uint64_t offset, std::uint64_t size) const = 0;
};

}  // namespace slf::storage::internal
