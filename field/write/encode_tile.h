// Encoding a tile of a field that is being written, from what is written of it.
#pragma once

#include "base/bytes.h"
#include "field/tiles/tile_cache.h"

namespace slf {

/// Encodes a tile for the field of `coarser`, as a difference from what the tiles of the next
/// coarser level predict, or from the same tile of an earlier state, whichever takes fewer bytes.
/// Errors of TileCache::load(). REQUIRES: the cache is of all states.
[[nodiscard]] Result<void> encode_tile(TileCache& coarser, TileKey key, ByteSpan samples,
                                       Bytes& payload);

}  // namespace slf
