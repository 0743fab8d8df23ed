// Multiplies colours by alpha.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace slf::codec {

/// color × alpha / 255, rounded. REQUIRES: both in 0..255.
[[nodiscard]] constexpr std::uint32_t premultiplied(std::uint32_t color, std::uint32_t alpha) {
  const std::uint32_t x = color * alpha + 128;
  return (x + (x >> 8)) >> 8;
}

/// Multiplies the colour of each pixel by its alpha, and stores the alpha. Pixels hold, from the
/// lowest byte on, R, G, B and 255. Compiled for several instruction sets. Thread-safe. REQUIRES:
/// as many pixels as alphas.
void premultiply(std::span<std::uint32_t> pixels, std::span<const std::uint8_t> alpha);

}  // namespace slf::codec
