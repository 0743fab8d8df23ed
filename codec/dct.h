// The 8 × 8 transform of the predictive codec: the integer DCT of HEVC (ITU-T H.265, 8.6.4.2). Its
// inverse uses integers only, so all decoders give the same pixels.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace slf::codec {

/// Coefficients and pixels of a block, row by row; rows of coefficients have equal vertical
/// frequency.
using Block = std::array<std::int16_t, 64>;

/// Coefficients are 16 times those of the orthonormal DCT.
inline constexpr int kCoefficientScale = 16;

/// The transpose of a matrix, times `scale`.
constexpr std::array<float, 64> transposed(const std::array<float, 64>& matrix, float scale = 1) {
  std::array<float, 64> columns{};
  for (std::size_t k = 0; k < 64; ++k) columns[k] = matrix[k % 8 * 8 + k / 8] * scale;
  return columns;
}

/// The product of two 8 × 8 matrices. Sums are in order, so all machines give the same floats.
void multiply(const float* a, std::size_t a_stride, const float* b, std::size_t b_stride,
              std::array<float, 64>& product);

/// The coefficients of a block of values: those of row y are at `values` + y * stride.
[[nodiscard]] std::array<float, 64> forward_dct(const float* values, std::size_t stride);

/// Computes pixels from quantised coefficients, which are multiplied by `steps` and limited to 16
/// bits, in 32-bit integers that no input overflows. Only the first `count` coefficients in zigzag
/// order may differ from 0. Pixel (x, y) goes to pixels[y * stride + x].
void restore_block(const Block& quantised, std::size_t count,
                   const std::array<std::int32_t, 64>& steps, std::int16_t* pixels,
                   std::size_t stride);

}  // namespace slf::codec
