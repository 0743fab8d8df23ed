// The numbers of a channel: the colours or the depths of tiles.
#pragma once

#include <vector>

#include "base/bytes.h"
#include "base/half.h"

namespace slf {

/// Converts a channel, half floats or bytes, to numbers from 0 to 1. Colours of HDR fields may be
/// larger.
inline void to_floats(bool half, ByteSpan channel, std::vector<float>& numbers) {
  numbers.resize(channel.size() / (half ? 2 : 1));
  for (std::size_t k = 0; k < numbers.size(); ++k)
    numbers[k] = half ? half_to_float(load_le<std::uint16_t>(channel.data() + 2 * k))
                      : static_cast<float>(std::to_integer<int>(channel[k])) / 255.F;
}

}  // namespace slf
