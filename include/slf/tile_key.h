// TileKey: a tile's place in its layer.
#pragma once

#include <compare>
#include <cstdint>

namespace slf {

/// Keys are ordered by level, then by the index within the level (FORMAT.md, "Tiles").
struct TileKey {
  std::uint8_t level = 0;
  std::uint64_t index = 0;
  friend auto operator<=>(const TileKey&, const TileKey&) = default;
};

}  // namespace slf
