// Directions spread evenly over the sphere.
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/vec3.hpp>
#include <numbers>

namespace slf {

/// Direction k of `count` on a spiral, each in the middle of an equal area (Swinbank, Purser 2006).
[[nodiscard]] inline glm::dvec3 even_direction(std::uint32_t k, std::uint32_t count) {
  const double z = 1 - (2.0 * k + 1) / count, across = std::sqrt(1 - z * z);
  const double angle = std::numbers::pi * (3 - std::sqrt(5.0)) * k;
  return {across * std::cos(angle), across * std::sin(angle), z};
}

}  // namespace slf
