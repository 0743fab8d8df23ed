// Prediction of 8-bit triangular pictures from the samples already seen (the MED predictor of
// JPEG-LS), and its inverse.
#pragma once

#include <cstdint>
#include <span>

namespace slf::codec {

/// Replaces every sample of one triangular picture by its difference, modulo 256, from the
/// prediction. `samples` and `residuals` hold (side+1)(side+2)/2 bytes, lines of constant q.
void predict(std::span<const std::uint8_t> samples, std::uint32_t side,
             std::span<std::uint8_t> residuals);

/// Undoes predict. Any residuals are safe.
void restore(std::span<const std::uint8_t> residuals, std::uint32_t side,
             std::span<std::uint8_t> samples);

}  // namespace slf::codec
