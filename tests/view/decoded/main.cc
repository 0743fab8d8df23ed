// decoded FIELD STRIDE: writes the decoded samples of every STRIDEth tile to standard output,
// colours then depths, in the order of the page's table (view/page/field.js). What page_test.py
// compares the page's own tiles with.

#include <cstdio>
#include <cstdlib>
#include <string>

#include "field/geometry/section.h"
#include "field/tiles/tile_cache.h"

namespace {

using namespace slf;

bool write_tile(TileCache& tiles, TileKey key) {
  const auto tile = tiles.load(key);
  if (!tile) return false;
  const ByteSpan samples = tile->samples();
  std::fwrite(samples.data(), 1, samples.size(), stdout);
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 1;
  const auto field = FieldFile::open(argv[1]);
  if (!field) return 2;
  TileCache tiles(**field, 64 << 20);
  const FieldShape& shape = (*field)->shape();
  const unsigned long stride = std::stoul(argv[2]);
  unsigned long page = 0;
  for (unsigned level = 0; level <= shape.levels; ++level) {
    const unsigned deeper = level + shape.entry_extra_levels;
    for (std::uint32_t entry = 0; entry < 8u << (2 * deeper); ++entry)
      for (std::uint32_t exit = 0; exit < 8u << (2 * level); ++exit, ++page) {
        if (page % stride != 0) continue;
        const TileKey key = tile_key(
            {{static_cast<std::uint8_t>(deeper), entry}, {static_cast<std::uint8_t>(level), exit}});
        if (!write_tile(tiles, key)) return 3;
      }
  }
  return 0;
}
