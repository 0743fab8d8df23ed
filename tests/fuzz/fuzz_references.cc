// Any bytes as the list of what tiles are predicted from: an error, or tiles of the next coarser
// level, which the list of what was found has again.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "field/reference_index.h"

namespace {

using namespace slf;

constexpr std::uint64_t kTiles = 1024;  // of level 1

std::vector<ReferenceIndex::Tile> tiles_of(const ReferenceIndex& index) {
  std::vector<ReferenceIndex::Tile> tiles;
  for (std::uint64_t k = 0; k < kTiles; ++k) {
    ReferenceIndex::Tile tile{{1, k}, {}};
    index.append_references(tile.key, tile.references);
    for (const TileKey reference : tile.references)
      if (reference.level != 0) std::abort();
    tiles.push_back(std::move(tile));
  }
  return tiles;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto index = ReferenceIndex::parse(std::as_bytes(std::span(data, size)), 1);
  if (!index) return 0;
  const auto tiles = tiles_of(*index);
  const auto again = ReferenceIndex::parse(ReferenceIndex::encode(tiles), 1);
  if (!again) std::abort();
  const auto same = [](const auto& a, const auto& b) { return a.references == b.references; };
  if (!std::ranges::equal(tiles, tiles_of(*again), same)) std::abort();
  return 0;
}
