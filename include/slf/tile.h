// Tile: the stored unit of a field; its key, and what its samples hold.
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>

namespace slf {

/// Keys are ordered by level, then by the index within the level (FORMAT.md, "Tiles").
struct TileKey {
  std::uint8_t level = 0;
  std::uint64_t index = 0;
  friend auto operator<=>(const TileKey&, const TileKey&) = default;
};

/// The content of a sample, in memory order.
enum class SampleFormat : std::uint8_t {
  rgba8 = 0,    ///< 4 bytes: premultiplied R, G, B and A
  depth8 = 1,   ///< 1 byte: depth along the chord, 0 at entry, 255 at exit
  rgba16f = 2,  ///< 8 bytes: premultiplied R, G, B, A as little-endian IEEE half floats
};

[[nodiscard]] constexpr std::size_t sample_bytes(SampleFormat format) {
  return format == SampleFormat::rgba8 ? 4 : format == SampleFormat::depth8 ? 1 : 8;
}

/// "rgba8", "depth8" or "rgba16f".
[[nodiscard]] constexpr const char* name(SampleFormat format) {
  return format == SampleFormat::rgba8    ? "rgba8"
         : format == SampleFormat::depth8 ? "depth8"
                                          : "rgba16f";
}

}  // namespace slf
