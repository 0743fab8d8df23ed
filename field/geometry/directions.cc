#include "field/geometry/directions.h"

#include <cmath>
#include <numbers>

namespace slf {

glm::dvec3 even_direction(std::uint32_t k, std::uint32_t count) {
  const double z = 1 - (2.0 * k + 1) / count, across = std::sqrt(1 - z * z);
  const double angle = std::numbers::pi * (3 - std::sqrt(5.0)) * k;
  return {across * std::cos(angle), across * std::sin(angle), z};
}

}  // namespace slf
