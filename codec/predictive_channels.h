// Tiles of the predictive codec without a transform (FORMAT.md, "Channels"): the difference from a
// prediction is coded sample by sample, exactly or within a quantisation step. This serves lossless
// fields and half floats.
#pragma once

#include <cstdint>
#include <span>

#include "base/bytes.h"
#include "codec/codec.h"
#include "codec/prediction.h"
#include "codec/predictive_tables.h"

namespace slf::codec {

/// A half float as an integer that grows with it, -32768..32767; and back.
[[nodiscard]] constexpr std::int32_t ordered_half(std::uint16_t bits) {
  return bits < 0x8000 ? bits : 0x7FFF - static_cast<std::int32_t>(bits);
}
[[nodiscard]] constexpr std::uint16_t half_of_ordered(std::int32_t ordered) {
  return static_cast<std::uint16_t>(ordered >= 0 ? ordered : 0x7FFF - ordered);
}

/// Encodes the samples of a tile with depths and appends them to `payload`.
void encode_channels(const PredictiveLevel& level, const TileShape& tile, ByteSpan samples,
                     const Predicted& from, Bytes& payload);

/// Undoes encode_channels. bad_file: the payload, untrusted, is longer or shorter than what it
/// codes, or predicted from other tiles.
[[nodiscard]] Result<void> decode_channels(const PredictiveLevel& level, const TileShape& tile,
                                           ByteSpan payload, const Predicted& from,
                                           std::span<std::byte> samples);

}  // namespace slf::codec
