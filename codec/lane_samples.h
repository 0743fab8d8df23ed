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
void load_colors(const TileShape& tile, const std::byte* colors, LaneValues* alpha,
                 LaneValues* color);

/// Undoes load_colors. With `clear`, samples of zero alpha become 0 in all channels.
void store_colors(const TileShape& tile, bool clear, const LaneValues* alpha,
                  const LaneValues* color, std::byte* colors);

/// Appends one byte per sample of a tile as a byte stream: depth, or alpha in steps.
[[nodiscard]] Result<void> append_bytes(const TileShape& tile, ByteSpan bytes, int level,
                                        Bytes& payload);

/// Undoes append_bytes and removes what it read from the front of `payload`; untrusted.
[[nodiscard]] Result<void> read_bytes(const TileShape& tile, ByteSpan& payload,
                                      std::span<std::byte> bytes);

}  // namespace slf::codec
