#include "codec/log_colors.h"

#include <algorithm>

#include "base/half.h"
#include "codec/color_kernel.h"

namespace slf::codec {
namespace {

// The 8-bit colour is about the logarithm of the straight colour, taken from the bits of its half
// float: 32 steps per octave, from 1/64 to 4.
constexpr int kDarkest = 0x2400, kShift = 5;

std::uint32_t log_color(std::uint16_t color, float alpha) {
  const std::uint16_t bits = half_from_float(half_to_float(color) / alpha);
  if (bits >= 0x8000) return 0;
  return static_cast<std::uint32_t>(std::clamp((bits - kDarkest) >> kShift, 0, 255));
}

}  // namespace

std::uint16_t half_from_log_color(std::uint8_t color, std::uint16_t alpha) {
  const auto bits = static_cast<std::uint16_t>(kDarkest + (color << kShift) + (1 << kShift) / 2);
  return half_from_float(half_to_float(bits) * half_to_float(alpha));
}

Bytes to_rgba8_depth8(ByteSpan half) {
  const std::size_t count = half.size() / 9;
  Bytes converted(5 * count);
  for (std::size_t s = 0; s < count; ++s) {
    std::uint16_t rgba[4];
    for (std::size_t c = 0; c < 4; ++c)
      rgba[c] = load_le<std::uint16_t>(half.data() + 8 * s + 2 * c);
    const std::uint32_t alpha = byte_from_half(rgba[3]);
    std::uint32_t pixel = alpha << 24;
    for (std::uint32_t c = 0; alpha != 0 && c < 3; ++c)
      pixel |= premultiplied(log_color(rgba[c], half_to_float(rgba[3])), alpha) << (8 * c);
    store_le(converted.data() + 4 * s, pixel);
  }
  std::copy(half.end() - static_cast<std::ptrdiff_t>(count), half.end(),
            converted.begin() + static_cast<std::ptrdiff_t>(4 * count));
  return converted;
}

}  // namespace slf::codec
