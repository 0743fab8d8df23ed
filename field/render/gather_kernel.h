// Gathering: from the cells of a block's rays to the samples at their corners. Compiled for several
// instruction sets. Private to field/render.
//
// A ray's result depends on the ray alone, never on its place in a block: lanes do not mix.
#pragma once

#include "field/render/block_tiles.h"
#include "field/render/ray_block.h"

namespace slf {

/// Adds the tiles that a pass over `count` rays samples to `tiles`, and numbers them for each ray.
void number_tiles(const Pass& pass, const EntryCells& entries, std::size_t count, BlockTiles& tiles,
                  TileNumbers& numbers);

/// Gathers a pass's samples from the tiles that have an offset; those of others are 0. `add`
/// combines them with what an earlier call gathered from other tiles.
/// REQUIRES: the 8 bytes before a tile's first sample can be read.
void gather_samples(const TileOffsets& offsets, const Pass& pass, const EntryCells& entries,
                    const TileNumbers& numbers, std::size_t count, bool half_floats, bool add,
                    BlockSamples& samples);

}  // namespace slf
