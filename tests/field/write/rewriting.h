// What tests of programs that rewrite or damage fields share.
#pragma once

#include <fstream>
#include <iterator>

#include "field/field_file.h"
#include "tests/field/field_testing.h"

namespace slf::testing {

/// The samples of every tile; an empty tile has none.
inline std::map<TileKey, Bytes> all_samples(const Field& field) {
  TileCache cache(field.file(), 16 << 20);
  std::map<TileKey, Bytes> tiles;
  const auto ok = field.file().store().visit({0, 0}, {255, 0},
                                             [&](const storage::TileRef& tile) -> Result<void> {
                                               Bytes& samples = tiles[tile.key];
                                               if (tile.state != storage::TileState::stored)
                                                 return {};
                                               return cache.read(tile.key, samples);
                                             });
  EXPECT_TRUE(ok) << (ok ? "" : ok.error().message);
  return tiles;
}

/// The colours of these.
inline std::map<TileKey, Bytes> all_colors(const Field& field) {
  auto tiles = all_samples(field);
  for (auto& [key, samples] : tiles)
    if (!samples.empty()) samples.resize(field.file().tile_shape(key).color_bytes());
  return tiles;
}

/// Rays with content everywhere but in a few tiles, none of it smooth; brighter than 1 where asked.
inline FunctionScene stripes(float brightness = 1) {
  return FunctionScene([brightness](const glm::dvec3& a, const glm::dvec3& b) {
    RaySample sample;
    if (glm::dot(a, b) > 0.2) return sample;
    const auto wave = [](double x) { return static_cast<float>(0.5 + 0.5 * std::sin(x)); };
    const float alpha = 0.25f + 0.75f * wave(9 * b.y);
    sample.rgba = {brightness * alpha * wave(5 * a.x + 7 * b.z), alpha * wave(11 * b.x),
                   alpha * wave(3 * a.z - 4 * b.y), alpha};
    sample.depth = 0.2f + 0.6f * wave(2 * a.y + b.x);
    return sample;
  });
}

}  // namespace slf::testing
