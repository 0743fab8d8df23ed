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
  std::uint64_t memory = 0;   ///< bytes, all in all
  std::uint64_t pending = 0;  ///< bytes of records that wait
  std::uint64_t cache = 0;    ///< of decoded tiles: as much for the input as for coarser tiles
  unsigned threads = 1;
  std::size_t window = 1;   ///< batches under way
  std::uint64_t batch = 1;  ///< tiles that a thread takes at a time

  /// Divides the bytes that are `given`; 0: the usual ones, or what one thread needs. `copies`:
  /// tiles are copied as they are. usage: that is too little for one thread; the message says what
  /// is enough. REQUIRES: threads > 0.
  [[nodiscard]] static Result<WriteBudget> divide(std::uint64_t given, const FieldShape& shape,
                                                  unsigned threads, bool copies,
                                                  const std::string& path);
};

inline constexpr std::uint64_t kUsualMemory = 256 << 20;

/// The bytes of decoded tiles that a reader beside a writer may keep.
[[nodiscard]] constexpr std::uint64_t cache_share(std::uint64_t given) {
  return (given ? given : kUsualMemory) / 12;
}

}  // namespace slf
