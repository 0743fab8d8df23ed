// Encoding a tile of a field that is being written, from what is written of it.
#pragma once

#include "base/bytes.h"
#include "field/tiles/tile_cache.h"

namespace slf {

/// Encodes a tile as a difference from what the tiles of the next coarser level predict, or from
/// the same tile of an earlier state, whichever takes fewer bytes. `coarser`: of the field, or of
/// another with the same coarser tiles; null if tiles are not predicted. `earlier`, not null in a
/// field of several states, has those; the rest of it need not be there. Errors of
/// TileCache::load(). REQUIRES: both show all states.
[[nodiscard]] Result<void> encode_tile(const TileCoder& coder, TileCache* coarser,
                                       const FieldFile* earlier, TileKey key, ByteSpan samples,
                                       Bytes& payload);

}  // namespace slf
