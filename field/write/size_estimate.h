// SizeEstimate: what the tiles of a new field take, from a sample of them.
#pragma once

#include <cstdint>

#include "base/reporter.h"
#include "field/geometry/tile_order.h"
#include "field/tile_coder.h"
#include "field/write/tile_source.h"

namespace slf {

/// A size that is estimated, or if its variance is 0, exact.
struct SizeEstimate {
  double bytes = 0, variance = 0;  ///< of payloads
  double stored = 0;               ///< tiles that have one
  double seconds = 0;         ///< of one processor, to read or trace the tiles and to encode them
  std::uint64_t sampled = 0;  ///< tiles that were encoded
  SizeEstimate& operator+=(const SizeEstimate& more);
  /// Half of a 95 % confidence interval of `bytes`.
  [[nodiscard]] double error() const;
};

/// Divides tiles into `samples` equal ranges, and estimates by encoding one tile of each, which
/// depends on their numbers alone; of some of them, also with prediction from tiles of `coarser`.
/// Progress counts samples.
[[nodiscard]] Result<SizeEstimate> sample_tiles(const TileSource& source, const TileSource& coarser,
                                                const TileCoder& coder, const TileOrder& order,
                                                NumberRange tiles, std::uint64_t samples,
                                                unsigned threads, Reporter& progress);

/// Of a file with these payloads, besides what it keeps of `kept` bytes.
struct FileEstimate {
  std::uint64_t bytes = 0, error_bytes = 0;
};
[[nodiscard]] FileEstimate file_estimate(const FieldShape& shape, const SizeEstimate& payloads,
                                         std::size_t kept);

}  // namespace slf
