// Lattice: the sample points of the plenoptic sphere, and the cell that contains a direction.
//
// lattice(N) has a vertex at normalize(i,j,k) for all signed integers with |i|+|j|+|k| = N:
// 4N²+2 in all. On each octsphere the barycentric coordinates of a direction (x,y,z) are
// (u, v, w) = (|x|, |y|, |z|) / (|x|+|y|+|z|)  (paper eq. 1). In these coordinates great arcs are
// straight lines, and the lattice is a regular triangular grid with N cells along each edge.
//
// The number of an octant has bit 0 set where x < 0, bit 1 where y < 0, and bit 2 where z < 0.
// All functions are pure. Directions need not have unit length.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

namespace slf {

/// A vertex, by its signed coordinates. The sum of their magnitudes is the lattice's resolution.
struct LatticeVertex {
  std::int32_t i = 0;
  std::int32_t j = 0;
  std::int32_t k = 0;
  friend bool operator==(const LatticeVertex&, const LatticeVertex&) = default;
  friend auto operator<=>(const LatticeVertex&, const LatticeVertex&) = default;
};

/// A vertex as seen from one octant: the first two barycentric coordinates, times N. A vertex on
/// the border of octants has one such address in each.
struct OctantPoint {
  std::int32_t x = 0;
  std::int32_t y = 0;
  friend bool operator==(const OctantPoint&, const OctantPoint&) = default;
};

/// Unit direction of a vertex.
[[nodiscard]] glm::dvec3 direction(const LatticeVertex& vertex);

/// The octant of a vertex. A zero coordinate counts as positive, so each vertex has exactly one.
[[nodiscard]] unsigned octant_of(const LatticeVertex& vertex);
[[nodiscard]] unsigned octant_of(const glm::dvec3& direction);

[[nodiscard]] LatticeVertex to_vertex(unsigned octant, OctantPoint point, std::int32_t resolution);
[[nodiscard]] OctantPoint to_octant_point(const LatticeVertex& vertex);

/// The adjacent vertices: six, or four at the six points where two coordinates are 0.
/// REQUIRES: the resolution is at least 1.
[[nodiscard]] std::vector<LatticeVertex> neighbors(const LatticeVertex& vertex);

/// The number of vertices of lattice(N): 4N²+2.
[[nodiscard]] constexpr std::uint64_t vertex_count(std::uint64_t resolution) {
  return 4 * resolution * resolution + 2;
}

/// The lattice cell that contains a point, and the point's weights for triangle interpolation
/// (eq. 2, and its mirror image for inverted cells).
/// An upright cell has the corners (x,y), (x+1,y), (x,y+1), an inverted one (x+1,y+1), (x,y+1),
/// (x+1,y). Weights have the same order, are in [0,1], and sum to 1.
struct Cell {
  unsigned octant = 0;
  OctantPoint base;
  bool inverted = false;
  std::array<double, 3> weights{};

  [[nodiscard]] std::array<OctantPoint, 3> corners() const;
};

/// Finds the cell of lattice(resolution) that contains a direction. On a border between cells,
/// returns either: interpolation is continuous there. REQUIRES: direction is finite and not zero.
[[nodiscard]] Cell locate(const glm::dvec3& direction, std::int32_t resolution);

}  // namespace slf
