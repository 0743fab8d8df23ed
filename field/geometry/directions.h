// Directions spread evenly over the sphere.
#pragma once

#include <cstdint>
#include <glm/vec3.hpp>

namespace slf {

/// Direction k of `count` on a spiral, each in the middle of an equal area (Swinbank, Purser 2006).
[[nodiscard]] glm::dvec3 even_direction(std::uint32_t k, std::uint32_t count);

}  // namespace slf
