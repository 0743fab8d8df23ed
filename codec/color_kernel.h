// The last steps of decoding colours, compiled for several instruction sets. Pixels hold, from the
// lowest byte on, R, G, B and alpha.
#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace slf::codec {

/// color × alpha / 255, rounded. REQUIRES: both in 0..255.
[[nodiscard]] constexpr std::uint32_t premultiplied(std::uint32_t color, std::uint32_t alpha) {
  const std::uint32_t x = color * alpha + 128;
  return (x + (x >> 8)) >> 8;
}

/// Multiplies the colour of each pixel, whose alpha is 255, by its alpha, and stores the alpha.
/// Thread-safe. REQUIRES: as many pixels as alphas.
void premultiply(std::span<std::uint32_t> pixels, std::span<const std::uint8_t> alpha);

/// Adds to each pixel a difference in YCbCr, [0] to [2] of `differences`, limited to its alpha
/// (FORMAT.md, "Blocks"). Thread-safe. REQUIRES: all spans are equally long.
void add_differences(const std::array<std::span<const std::int16_t>, 3>& differences,
                     std::span<std::uint32_t> pixels);

}  // namespace slf::codec
