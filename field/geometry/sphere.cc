#include "slf/shape.h"

#include <cmath>

namespace slf {

Chord intersect(const Sphere& sphere, const glm::dvec3& origin, const glm::dvec3& direction) {
  // Start from the point nearest the centre: this stays accurate for distant origins.
  const double length2 = glm::dot(direction, direction);
  const glm::dvec3 to_center = sphere.center - origin;
  const double nearest = glm::dot(to_center, direction) / length2;
  const glm::dvec3 offset = to_center - nearest * direction;
  const double rest = sphere.radius * sphere.radius - glm::dot(offset, offset);
  if (!(rest > 0)) return {};
  const double half = std::sqrt(rest / length2);
  return {true, nearest - half, nearest + half};
}

}  // namespace slf
