// Tiles, the stored units of a field: their keys, and the formats of their samples.
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>

namespace slf {

/// Names a tile of a field. Keys are ordered by level, state of the object, and the index within
/// the level (FORMAT.md, "Tiles").
struct TileKey {
  std::uint8_t level = 0;
  std::uint16_t state = 0;
  std::uint64_t index = 0;

  constexpr TileKey() = default;
  constexpr TileKey(std::uint8_t of_level, std::uint64_t at, std::uint16_t of_state = 0)
      : level(of_level), state(of_state), index(at) {}
  friend auto operator<=>(const TileKey&, const TileKey&) = default;
};

/// What a file holds of a tile.
enum class TileState : std::uint8_t {
  missing,  ///< never built, or dropped because it was damaged
  empty,    ///< built; nothing is visible along any of its rays
  stored,   ///< has a payload
  same,     ///< has the payload of this tile in an earlier state of the object
};

inline constexpr unsigned kMaxStates = 1 << 12;
/// This tile of another state.
[[nodiscard]] constexpr TileKey in_state(TileKey key, std::uint64_t state) {
  return {key.level, key.index, static_cast<std::uint16_t>(state)};
}

/// For hash tables of tiles.
struct TileKeyHash {
  std::size_t operator()(TileKey key) const {
    const std::uint64_t index = key.index | std::uint64_t{key.state} << 50;
    return static_cast<std::size_t>((index * 0x9E3779B97F4A7C15u) ^
                                    (std::uint64_t{key.level} << 56));
  }
};

/// The tiles with keys in [begin, end), in key order.
struct TileRange {
  TileKey begin;
  TileKey end;
  friend bool operator==(const TileRange&, const TileRange&) = default;
};

/// The content of a sample. A tile has the colours of all its samples, then, if there are any, the
/// depths of all.
enum class SampleFormat : std::uint8_t {
  rgba8,           ///< 4 bytes: premultiplied R, G, B and A
  rgba16f,         ///< 8 bytes: premultiplied R, G, B, A as little-endian IEEE half floats
  rgba8_depth8,    ///< 5 bytes: also depth along the chord, 0 at entry, 255 at exit
  rgba16f_depth8,  ///< 9 bytes: the same with rgba16f
};

[[nodiscard]] constexpr SampleFormat sample_format(bool half, bool depth) {
  return static_cast<SampleFormat>((half ? 1 : 0) + (depth ? 2 : 0));
}
/// Whether colours are half floats.
[[nodiscard]] constexpr bool is_half(SampleFormat format) {
  return static_cast<unsigned>(format) % 2 == 1;
}
[[nodiscard]] constexpr bool has_depth(SampleFormat format) {
  return format >= SampleFormat::rgba8_depth8;
}

[[nodiscard]] constexpr std::size_t color_bytes(SampleFormat format) {
  return is_half(format) ? 8 : 4;
}
[[nodiscard]] constexpr std::size_t sample_bytes(SampleFormat format) {
  return color_bytes(format) + (has_depth(format) ? 1 : 0);
}

/// The name of the format in manifests, such as "rgba8".
[[nodiscard]] constexpr const char* name(SampleFormat format) {
  constexpr const char* kNames[] = {"rgba8", "rgba16f", "rgba8_depth8", "rgba16f_depth8"};
  return kNames[static_cast<std::size_t>(format)];
}

}  // namespace slf
