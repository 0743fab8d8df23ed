// Gathering: reads the samples at the corners of a block's cells. Compiled for several instruction
// sets. Private to field/render.
#pragma once

#include "field/render/block_tiles.h"
#include "field/render/ray_block.h"

namespace slf {

/// Finds the tiles that a pass over `count` rays samples: in the table, or with tiles.find().
/// Marks rays that need an unavailable one.
/// REQUIRES: a ReadScope until the samples are gathered.
void find_tiles(const Pass& pass, const EntryCells& entries, std::size_t count, BlockTiles& tiles,
                TileOffsets& offsets);

/// Gathers a pass's samples from the tiles that were found. If `add`, keeps the samples that
/// earlier calls gathered. REQUIRES: the 8 bytes before a tile's first sample can be read.
void gather_samples(const TileOffsets& offsets, const Pass& pass, const EntryCells& entries,
                    std::size_t count, bool half_floats, bool add, BlockSamples& samples);

}  // namespace slf
