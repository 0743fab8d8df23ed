// What rays see: the samples they take from tiles, and their blend, on blocks of rays, compiled for
// several instruction sets. Private to field/.
//
// A ray's result depends on the ray alone, never on its place in a block: lanes do not mix.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>

#include "field/render/ray_block.h"
#include "field/render/tile_numbers.h"

namespace slf {

/// Numbers the tiles that a pass over `count` rays samples.
void number_tiles(const Pass& pass, const EntryArrays& entries, std::size_t count,
                  TileNumbers& numbers, TileArrays& tiles);

/// Takes a pass's samples from the tiles that are there; those of other tiles are 0. `add` combines
/// them with what was taken before from other tiles.
/// REQUIRES: the 8 bytes before a tile's first sample can be read.
void take_samples(const TileOffsets& offsets, const Pass& pass, const EntryArrays& entries,
                  const TileArrays& tiles, std::size_t count, bool half_floats, bool add,
                  SampleArrays& samples);

/// Blends each ray's samples (eq. 2) into its pixel of a picture: premultiplied colours; and, where
/// the pass has depth, `t`, the opacity-weighted depth along the ray, and in `entries` the next
/// aims: all three vertices at `t`, or nowhere where too little is seen. A pass with a spread,
/// which aimed already, aims each vertex halfway between `t`, which stays what it was where too
/// little is seen, and what the vertex saw.
void blend(const Pass& pass, const RayBlock& rays, EntryArrays& entries,
           const SampleArrays& samples, bool half_floats, glm::vec4* picture, float* t);

}  // namespace slf
