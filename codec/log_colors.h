// Tiles of half floats are predicted from their colours in 8 bits (FORMAT.md, "Half floats").
#pragma once

#include <cstdint>

#include "base/bytes.h"

namespace slf::codec {

/// Converts rgba16f_depth8 samples to the rgba8_depth8 samples from which others are predicted.
[[nodiscard]] Bytes to_rgba8_depth8(ByteSpan half);

/// Converts a predicted 8-bit colour back and multiplies it by the opacity `alpha`. The opacity and
/// the result are half floats, as bits.
[[nodiscard]] std::uint16_t half_from_log_color(std::uint8_t color, std::uint16_t alpha);

}  // namespace slf::codec
