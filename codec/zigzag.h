// The zigzag order of an 8 × 8 block of coefficients, from low frequencies to high.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace slf::codec {

/// Entry k is the index, row by row, of the k-th coefficient.
inline constexpr std::array<std::uint8_t, 64> kZigzag = [] {
  std::array<std::uint8_t, 64> order{};
  std::size_t n = 0;
  for (int sum = 0; sum < 15; ++sum)
    for (int k = 0; k <= sum; ++k) {
      const int x = sum % 2 ? sum - k : k, y = sum - x;
      if (x < 8 && y < 8) order[n++] = static_cast<std::uint8_t>(8 * y + x);
    }
  return order;
}();

}  // namespace slf::codec
