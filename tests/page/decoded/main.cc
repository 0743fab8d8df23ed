// What pictures_test.py compares the page with.
//
// decoded FIELD STRIDE: writes the decoded samples of every STRIDEth tile to standard output,
// colours then depths, in the order of the page's table (page/web/field.js).
//
// decoded --tones CURVE EXPOSURE: maps colours from standard input to standard output, four f32
// each. CURVE is the number of a ToneCurve.
//
// decoded --looks FIELD TEXT…: writes a line for each structure that the texts show: its state, its
// opacity and its tint, in bytes. Exits with 4 if a text names none or is refused.

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "field/geometry/section.h"
#include "field/structure_looks.h"
#include "field/tiles/tile_cache.h"
#include "slf/tone.h"

namespace {

using namespace slf;

bool write_tile(TileCache& tiles, TileKey key) {
  const auto tile = tiles.load(key);
  if (!tile) return false;
  const ByteSpan samples = tile->samples();
  std::fwrite(samples.data(), 1, samples.size(), stdout);
  return true;
}

int map_tones(const char* curve, const char* exposure) {
  const ToneMapper map({std::stof(exposure), static_cast<ToneCurve>(std::stoi(curve))});
  for (glm::vec4 color; std::fread(&color, sizeof color, 1, stdin) == 1;) {
    color = map(color);
    std::fwrite(&color, sizeof color, 1, stdout);
  }
  return 0;
}

int list_looks(const char* path, const std::vector<std::string>& texts) {
  const auto field = Field::open(path);
  if (!field) return 2;
  std::vector<StructureLook> unknown;
  const auto looks = parse_structures(texts, field->states());
  if (!looks) return 4;
  const auto shown = structures_of(*field, *looks, unknown);
  if (!shown || !unknown.empty() || (!shown->empty() && !compose(*field, *shown))) return 4;
  for (const Structure& one : *shown) {
    const auto byte = [&](int c) { return std::lround(255 * one.tint[c]); };
    std::printf("%u %g #%02lx%02lx%02lx\n", one.field.state(), static_cast<double>(one.opacity),
                byte(0), byte(1), byte(2));
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 3 && argv[1] == std::string("--looks"))
    return list_looks(argv[2], {argv + 3, argv + argc});
  if (argc == 4 && argv[1] == std::string("--tones")) return map_tones(argv[2], argv[3]);
  if (argc != 3) return 1;
  const auto field = FieldFile::open(argv[1]);
  if (!field) return 2;
  TileCache tiles(**field, 64 << 20);
  const FieldShape& shape = (*field)->shape();
  const unsigned long stride = std::stoul(argv[2]);
  unsigned long page = 0;
  for (unsigned level = 0; level <= shape.finest_level; ++level) {
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
