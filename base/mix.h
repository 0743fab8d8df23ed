// A hash of integers, for pseudo-random choices that are the same on every machine.
#pragma once

#include <cstdint>

namespace slf {

/// The increment of splitmix64 (Steele, Lea, Flood 2014): mix(x), mix(x + kMixStep), … is its
/// sequence.
inline constexpr std::uint64_t kMixStep = 0x9E3779B97F4A7C15u;

/// The output function of splitmix64: a bijection.
[[nodiscard]] constexpr std::uint64_t mix(std::uint64_t x) {
  x += kMixStep;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
  return x ^ (x >> 31);
}

}  // namespace slf
