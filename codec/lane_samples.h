// Converts the samples of a tile to lanes and back.
#pragma once

#include "codec/codec.h"
#include "codec/lanes.h"

namespace slf::codec {

/// How many channels a format has besides alpha. rgba8: G, R, B. rgba16f: G, R - G, B - G, where
/// each half float is first mapped to an integer that grows with its value (+0 becomes 0). depth8:
/// depth.
[[nodiscard]] constexpr std::size_t color_channels(SampleFormat format) {
  return format == SampleFormat::depth8 ? 1 : 3;
}
[[nodiscard]] constexpr bool has_alpha(SampleFormat format) {
  return format != SampleFormat::depth8;
}
[[nodiscard]] constexpr std::uint32_t value_bits(SampleFormat format) {
  return format == SampleFormat::rgba16f ? 16 : 8;
}

/// Copies a tile's samples to `alpha` [group][column] (null for formats without alpha) and `color`
/// [group][channel][column]. Lanes without a picture become 0.
void load(const Tile& tile, const std::byte* samples, LaneValues* alpha, LaneValues* color);

/// Undoes load. With `clear`, samples of zero alpha become 0 in all channels.
void store(const Tile& tile, bool clear, const LaneValues* alpha, const LaneValues* color,
           std::byte* samples);

}  // namespace slf::codec
