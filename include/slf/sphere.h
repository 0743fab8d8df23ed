// Sphere: the plenoptic sphere around an object, and where lines cross it.
#pragma once

#include <glm/glm.hpp>

namespace slf {

/// The plenoptic sphere: centre and radius in world units.
struct Sphere {
  glm::dvec3 center{0.0};
  double radius = 1;
};

/// Where a line meets a sphere, as parameters along origin + t·direction; `hit` is false when it
/// misses or only touches. REQUIRES: direction is not zero.
struct Chord {
  bool hit = false;
  double enter = 0;
  double leave = 0;
};
[[nodiscard]] Chord intersect(const Sphere& sphere, const glm::dvec3& origin,
                              const glm::dvec3& direction);

}  // namespace slf
