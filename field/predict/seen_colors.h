// What predictions are made from in tiles of half floats: their colours in 8 bits (FORMAT.md,
// "Half floats").
#pragma once

#include <cstdint>

#include "base/bytes.h"

namespace slf {

/// The rgba8_depth8 samples that stand for rgba16f_depth8 ones.
[[nodiscard]] Bytes seen_samples(ByteSpan half);

/// Half floats, as bits, of a predicted opacity and of a predicted colour times an opacity.
[[nodiscard]] std::uint16_t half_of_seen_alpha(std::uint8_t alpha);
[[nodiscard]] std::uint16_t half_of_seen_color(std::uint8_t color, std::uint16_t alpha);

/// An opacity in 8 bits.
[[nodiscard]] std::uint8_t seen_alpha(std::uint16_t alpha);

}  // namespace slf
