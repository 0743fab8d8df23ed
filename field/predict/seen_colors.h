// What predictions are made from in tiles of half floats: their colours in 8 bits (FORMAT.md,
// "Half floats").
#pragma once

#include <cstdint>

#include "base/bytes.h"

namespace slf {

/// The rgba8_depth8 samples that stand for rgba16f_depth8 ones.
[[nodiscard]] Bytes seen_samples(ByteSpan half);

/// A predicted colour times an opacity, as the bits of half floats.
[[nodiscard]] std::uint16_t half_of_seen_color(std::uint8_t color, std::uint16_t alpha);

}  // namespace slf
