// Tiles, the stored units of a field: their keys, and the formats of their samples.
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>

namespace slf {

/// Names a tile of a field. Keys are ordered by level, then by the index within the level
/// (FORMAT.md, "Tiles").
struct TileKey {
  std::uint8_t level = 0;
  std::uint64_t index = 0;
  friend auto operator<=>(const TileKey&, const TileKey&) = default;
};

/// For hash tables of tiles.
struct TileKeyHash {
  std::size_t operator()(TileKey key) const {
    return static_cast<std::size_t>((key.index * 0x9E3779B97F4A7C15u) ^
                                    (std::uint64_t{key.level} << 56));
  }
};

/// The tiles with keys in [begin, end), in key order.
struct TileRange {
  TileKey begin;
  TileKey end;
  friend bool operator==(const TileRange&, const TileRange&) = default;
};

/// The content of a sample, in memory order.
enum class SampleFormat : std::uint8_t {
  rgba8 = 0,           ///< 4 bytes: premultiplied R, G, B and A
  depth8 = 1,          ///< 1 byte: depth along the chord, 0 at entry, 255 at exit
  rgba16f = 2,         ///< 8 bytes: premultiplied R, G, B, A as little-endian IEEE half floats
  rgba8_depth8 = 3,    ///< 5 bytes: a tile has the rgba8 of all samples, then the depth8 of all
  rgba16f_depth8 = 4,  ///< 9 bytes: the same with rgba16f
};

[[nodiscard]] constexpr std::size_t sample_bytes(SampleFormat format) {
  constexpr std::size_t kBytes[] = {4, 1, 8, 5, 9};
  return kBytes[static_cast<std::size_t>(format)];
}

/// Whether samples have both a colour and a depth.
[[nodiscard]] constexpr bool has_color_and_depth(SampleFormat format) {
  return format == SampleFormat::rgba8_depth8 || format == SampleFormat::rgba16f_depth8;
}

/// The format of the colours alone. Formats that are not combined are returned as they are.
[[nodiscard]] constexpr SampleFormat color_format(SampleFormat format) {
  return format == SampleFormat::rgba8_depth8     ? SampleFormat::rgba8
         : format == SampleFormat::rgba16f_depth8 ? SampleFormat::rgba16f
                                                  : format;
}

/// The name of the format in manifests, such as "rgba8".
[[nodiscard]] constexpr const char* name(SampleFormat format) {
  constexpr const char* kNames[] = {"rgba8", "depth8", "rgba16f", "rgba8_depth8", "rgba16f_depth8"};
  return kNames[static_cast<std::size_t>(format)];
}

}  // namespace slf
