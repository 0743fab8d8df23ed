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

/// From the three coded planes of colour to R, G and B: row by row, in 1/256.
using ColorMatrix = std::array<std::int16_t, 9>;
inline constexpr ColorMatrix kYcbcr{256, 0, 359, 256, -88, -183, 256, 454, 0};
/// Elements of a matrix are within ±kMaxMatrix, so that sums stay below 2^31.
inline constexpr std::int16_t kMaxMatrix = 1024;

/// The inverse of a matrix, times its determinant.
[[nodiscard]] constexpr std::array<std::int64_t, 9> adjugate(const ColorMatrix& m) {
  std::array<std::int64_t, 9> adjugate{};
  const auto at = [&](std::size_t row, std::size_t column) -> std::int64_t {
    return m[row % 3 * 3 + column % 3];
  };
  for (std::size_t row = 0; row < 3; ++row)
    for (std::size_t column = 0; column < 3; ++column)
      adjugate[3 * row + column] = at(column + 1, row + 1) * at(column + 2, row + 2) -
                                   at(column + 1, row + 2) * at(column + 2, row + 1);
  return adjugate;
}
[[nodiscard]] constexpr std::int64_t determinant(const ColorMatrix& m) {
  const auto by = adjugate(m);
  return m[0] * by[0] + m[1] * by[3] + m[2] * by[6];
}

/// Adds to each pixel `matrix` times [0] to [2] of `differences`, limited to its alpha (FORMAT.md,
/// "Blocks"). Thread-safe. REQUIRES: all spans are equally long.
void add_differences(const std::array<std::span<const std::int16_t>, 3>& differences,
                     const ColorMatrix& matrix, std::span<std::uint32_t> pixels);

}  // namespace slf::codec
