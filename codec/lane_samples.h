// Samples of a tile to lanes and back.
#pragma once

#include "codec/codec.h"
#include "codec/lanes.h"

namespace slf::codec {

/// What the lanes of a format hold besides alpha: rgba8 G, R, B; rgba16f G, R - G, B - G, each half
/// first made an integer that grows with its value, +0 being 0; depth8 the depth.
[[nodiscard]] constexpr std::size_t color_channels(SampleFormat format) {
  return format == SampleFormat::depth8 ? 1 : 3;
}
[[nodiscard]] constexpr bool has_alpha(SampleFormat format) {
  return format != SampleFormat::depth8;
}
[[nodiscard]] constexpr std::uint32_t value_bits(SampleFormat format) {
  return format == SampleFormat::rgba16f ? 16 : 8;
}

/// Moves a tile's samples into `alpha` [group][column], null where there is none, and `color`
/// [group][channel][column]. Lanes without a picture are 0.
void load(const Tile& tile, const std::byte* samples, LaneValues* alpha, LaneValues* color);

/// Undoes load, and clears all samples of zero alpha if `clear`.
void store(const Tile& tile, bool clear, const LaneValues* alpha, const LaneValues* color,
           std::byte* samples);

}  // namespace slf::codec
