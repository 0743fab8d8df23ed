// Conversions of colours between bytes, floats, and IEEE 754 binary16 numbers ("half floats"),
// which are held as bits. Our own, because decoders are also compiled to WebAssembly, where Imath
// is not available.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

namespace slf {

/// The value of a half float, exactly.
[[nodiscard]] inline float half_to_float(std::uint16_t bits) {
  const std::uint32_t sign = (bits & 0x8000u) << 16, rest = bits & 0x7FFFu;
  if (rest >= 0x7C00) return std::bit_cast<float>(sign | 0x7F800000u | (rest & 0x3FFu) << 13);
  // The multiplication adjusts the exponent and, unlike integer arithmetic, handles subnormals.
  return std::bit_cast<float>(
      sign | std::bit_cast<std::uint32_t>(std::bit_cast<float>(rest << 13) * 0x1p112f));
}

/// The nearest half float, ties to even.
[[nodiscard]] inline std::uint16_t half_from_float(float value) {
  const std::uint32_t bits = std::bit_cast<std::uint32_t>(value), sign = bits >> 16 & 0x8000u;
  const std::uint32_t rest = bits & 0x7FFFFFFFu;
  std::uint32_t half;
  if (rest > 0x7F800000u)
    half = 0x7E00;  // not a number
  else if (rest >= 0x477FF000u)
    half = 0x7C00;  // 65520 and above
  else if (rest < 0x38800000u)
    // A subnormal half: adding 0.5 rounds, and leaves the half's bits in the sum's lowest bits.
    half = std::bit_cast<std::uint32_t>(std::bit_cast<float>(rest) + 0.5f) - 0x3F000000u;
  else
    half = (rest - 0x38000000u + 0xFFFu + (rest >> 13 & 1)) >> 13;
  return static_cast<std::uint16_t>(sign | half);
}

/// A half float as an integer that grows with it, -32768..32767; and back.
[[nodiscard]] constexpr std::int32_t ordered_half(std::uint16_t bits) {
  return bits < 0x8000 ? bits : 0x7FFF - static_cast<std::int32_t>(bits);
}
[[nodiscard]] constexpr std::uint16_t half_of_ordered(std::int32_t ordered) {
  return static_cast<std::uint16_t>(ordered >= 0 ? ordered : 0x7FFF - ordered);
}

/// The value, clamped to 0..1, as the nearest of 0..255. NaN becomes 0.
[[nodiscard]] inline std::uint8_t byte_from_float(float value) {
  return static_cast<std::uint8_t>(value > 0 ? std::min(value, 1.f) * 255 + 0.5f : 0.f);
}
[[nodiscard]] inline std::uint8_t byte_from_half(std::uint16_t bits) {
  return byte_from_float(half_to_float(bits));
}
/// The half float nearest to byte / 255.
[[nodiscard]] inline std::uint16_t half_from_byte(std::uint8_t byte) {
  return half_from_float(static_cast<float>(byte) / 255);
}

}  // namespace slf
