// WriteBudget: how a command that writes a field divides its memory.
#pragma once

#include <cstdint>
#include <string>

#include "slf/error.h"
#include "slf/shape.h"

namespace slf {

/// A third of the memory is for tiles under way and the caches beside them, a third for records
/// that wait for their commit, a third for LMDB's copies of their pages.
struct WriteBudget {
  std::uint64_t pending = 0;  ///< bytes of records that wait
  std::uint64_t cache = 0;    ///< of decoded tiles: as much for the input as for coarser tiles
  unsigned threads = 1;
  std::size_t window = 1;  ///< tiles under way

  /// Divides `memory` bytes. usage: that is too little for one thread; the message says what is
  /// enough. REQUIRES: threads > 0.
  [[nodiscard]] static Result<WriteBudget> divide(std::uint64_t memory, const FieldShape& shape,
                                                  unsigned threads, const std::string& path);
};

/// usage: `memory` is less than the `least` bytes that will do.
[[nodiscard]] Result<void> check_memory(std::uint64_t memory, std::uint64_t least,
                                        const std::string& path);

}  // namespace slf
