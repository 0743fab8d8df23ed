#include "field/geometry/lattice.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace slf {

glm::dvec3 direction(const LatticeVertex& vertex) {
  return glm::normalize(glm::dvec3(vertex.i, vertex.j, vertex.k));
}

unsigned octant_of(const LatticeVertex& vertex) {
  return (vertex.i < 0 ? 1u : 0u) | (vertex.j < 0 ? 2u : 0u) | (vertex.k < 0 ? 4u : 0u);
}

unsigned octant_of(const glm::dvec3& direction) {
  return (direction.x < 0 ? 1u : 0u) | (direction.y < 0 ? 2u : 0u) | (direction.z < 0 ? 4u : 0u);
}

LatticeVertex to_vertex(unsigned octant, OctantPoint point, std::int32_t resolution) {
  const std::int32_t z = resolution - point.x - point.y;
  return {octant & 1 ? -point.x : point.x, octant & 2 ? -point.y : point.y, octant & 4 ? -z : z};
}

OctantPoint to_octant_point(const LatticeVertex& vertex) {
  return {std::abs(vertex.i), std::abs(vertex.j)};
}

std::vector<LatticeVertex> neighbors(const LatticeVertex& vertex) {
  // An edge moves one unit from one coordinate to another; a coordinate of 0 may take either sign.
  const std::array<std::int32_t, 3> at{vertex.i, vertex.j, vertex.k};
  std::vector<LatticeVertex> found;
  for (std::size_t from = 0; from < 3; ++from)
    for (std::size_t to = 0; to < 3; ++to)
      for (const std::int32_t sign : {1, -1}) {
        if (from == to || at[from] == 0 || at[to] * sign < 0) continue;
        auto next = at;
        next[from] -= at[from] > 0 ? 1 : -1;
        next[to] += sign;
        found.push_back({next[0], next[1], next[2]});
      }
  return found;
}

std::array<OctantPoint, 3> Cell::corners() const {
  const auto [x, y] = base;
  if (inverted) return {{{x + 1, y + 1}, {x, y + 1}, {x + 1, y}}};
  return {{{x, y}, {x + 1, y}, {x, y + 1}}};
}

Cell locate(const glm::dvec3& direction, std::int32_t resolution) {
  const glm::dvec3 a = glm::abs(direction);
  const double scale = resolution / (a.x + a.y + a.z);
  const double x = a.x * scale;
  const double y = a.y * scale;

  // A point on the far edge belongs to the last cell, not to one beyond the octsphere.
  Cell cell;
  cell.octant = octant_of(direction);
  cell.base.x = std::clamp(static_cast<std::int32_t>(x), 0, resolution - 1);
  cell.base.y = std::clamp(static_cast<std::int32_t>(y), 0, resolution - 1 - cell.base.x);
  const double du = std::clamp(x - cell.base.x, 0.0, 1.0);
  const double dv = std::clamp(y - cell.base.y, 0.0, 1.0);

  const bool last_diagonal = cell.base.x + cell.base.y == resolution - 1;
  cell.inverted = du + dv > 1 && !last_diagonal;
  if (cell.inverted) {
    cell.weights = {du + dv - 1, 1 - du, 1 - dv};
  } else {
    const double excess = std::max(1.0, du + dv);  // above 1 only by rounding, on the last diagonal
    cell.weights = {1 - (du + dv) / excess, du / excess, dv / excess};
  }
  return cell;
}

}  // namespace slf
