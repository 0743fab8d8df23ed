// A hash of integers, for choices that look random and are the same on every machine.
#pragma once

#include <cstdint>

namespace slf {

/// What lies between the inputs of neighbouring numbers of splitmix64 (Steele, Lea, Flood 2014).
inline constexpr std::uint64_t kMixStep = 0x9E3779B97F4A7C15u;

/// splitmix64: every input has another output.
[[nodiscard]] constexpr std::uint64_t mix(std::uint64_t x) {
  x += kMixStep;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
  return x ^ (x >> 31);
}

}  // namespace slf
