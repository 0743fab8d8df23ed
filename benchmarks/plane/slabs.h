// The traditional parameterisation: light slabs between parallel planes (Levoy and Hanrahan 1996).
//
// Six pairs of planes cover all directed rays that cross a sphere: pair 2a + s holds those whose
// direction has its greatest component along axis a, which is negative if s is 1. Within a pair, a
// ray is given by the points (u,v) and (s,t) where it crosses the first and the second plane. Each
// plane has a regular grid.
//
// Coordinates are those of the unit sphere around the origin. In the frame of a pair the ray runs
// along +z; x and y are the next two axes, in cyclic order.
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>

namespace slf::bench {

/// Where the planes of every pair are and how finely they are sampled.
struct PlaneShape {
  double first = -1;             ///< height of the uv plane in the pair's frame
  double second = 1;             ///< of the st plane; above `first`
  std::int32_t first_nodes = 2;  ///< along an edge
  std::int32_t second_nodes = 2;

  /// Half an edge of a plane: room for all rays with slopes of at most 1 that cross the sphere.
  [[nodiscard]] static double extent(double height) { return std::sqrt(2.0) + std::abs(height); }
  /// Slabs of all six pairs, including those that miss the sphere.
  [[nodiscard]] double nominal_slabs() const {
    return 6 * std::pow(first_nodes, 2) * std::pow(second_nodes, 2);
  }
};

/// The pair of a direction.
[[nodiscard]] inline unsigned pair_of(const glm::dvec3& d) {
  const glm::dvec3 a = glm::abs(d);
  const int axis = a.x >= a.y && a.x >= a.z ? 0 : a.y >= a.z ? 1 : 2;
  return 2 * static_cast<unsigned>(axis) + (d[axis] < 0);
}

/// A world vector in a pair's frame, and back.
[[nodiscard]] inline glm::dvec3 to_pair(unsigned pair, const glm::dvec3& v) {
  const int axis = static_cast<int>(pair / 2);
  return {v[(axis + 1) % 3], v[(axis + 2) % 3], pair % 2 ? -v[axis] : v[axis]};
}
[[nodiscard]] inline glm::dvec3 from_pair(unsigned pair, const glm::dvec3& v) {
  const int axis = static_cast<int>(pair / 2);
  glm::dvec3 out;
  out[(axis + 1) % 3] = v.x;
  out[(axis + 2) % 3] = v.y;
  out[axis] = pair % 2 ? -v.z : v.z;
  return out;
}

/// Position of a node on a plane, along one axis.
[[nodiscard]] inline double node_at(double height, std::int32_t nodes, std::int32_t k) {
  return PlaneShape::extent(height) * (2.0 * k / (nodes - 1) - 1);
}

}  // namespace slf::bench
