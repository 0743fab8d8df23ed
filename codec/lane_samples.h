// Converts the samples of a tile to lanes and back.
#pragma once

#include "codec/codec.h"
#include "codec/lanes.h"

namespace slf::codec {

/// The channels of colour besides alpha. 8 bits: G, R, B. Half floats: G, R - G, B - G, where each
/// half float is first mapped to an integer that grows with its value (+0 becomes 0).
inline constexpr std::size_t kColorChannels = 3;

/// The bits of a value of colour or alpha.
[[nodiscard]] constexpr std::uint32_t value_bits(SampleFormat format) {
  return is_half(format) ? 16 : 8;
}

/// Copies a tile's colours to `alpha` [group][column] and `color` [group][channel][column]. Lanes
/// without a picture become 0.
void load_colors(const Tile& tile, const std::byte* colors, LaneValues* alpha, LaneValues* color);

/// Undoes load_colors. With `clear`, samples of zero alpha become 0 in all channels.
void store_colors(const Tile& tile, bool clear, const LaneValues* alpha, const LaneValues* color,
                  std::byte* colors);

/// Copies one byte per sample of a tile to `values` [group][column], and back.
void load_bytes(const Tile& tile, const std::byte* bytes, LaneValues* values);
void store_bytes(const Tile& tile, const LaneValues* values, std::byte* bytes);

}  // namespace slf::codec
