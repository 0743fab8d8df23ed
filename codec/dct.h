// The 8 × 8 transform of the predictive codec: the integer DCT of HEVC (ITU-T H.265, 8.6.4.2). Its
// inverse uses integers only, so all decoders give the same pixels.
#pragma once

#include <array>
#include <cstdint>

namespace slf::codec {

/// Coefficients and pixels of a block, row by row; rows of coefficients have equal vertical
/// frequency.
using Block = std::array<std::int16_t, 64>;

/// Coefficients are 16 times those of the orthonormal DCT.
inline constexpr int kCoefficientScale = 16;

/// The coefficients of a block of values.
[[nodiscard]] std::array<float, 64> forward_dct(const std::array<float, 64>& values);

/// Computes pixels from quantised coefficients, which are multiplied by `steps` and limited to 16
/// bits, in 32-bit integers that no input overflows. Only the first `count` coefficients in zigzag
/// order may differ from 0. Pixel (x, y) goes to pixels[y * stride + x].
void restore_block(const Block& quantised, std::size_t count,
                   const std::array<std::int32_t, 64>& steps, std::int16_t* pixels,
                   std::size_t stride);

}  // namespace slf::codec
