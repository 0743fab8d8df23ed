#include "field/geometry/section.h"

#include <cmath>

namespace slf {
namespace {

/// Barycentric coordinates. Their sum is the same in all children.
template <class T>
struct Barycentric {
  T a, b, c;

  /// Converts to the coordinates of the child that contains this point, and returns its number.
  /// This is the only place that breaks ties.
  unsigned descend() {
    const T sum = a + b + c;
    if (2 * a >= sum) return *this = {2 * a - sum, 2 * b, 2 * c}, 0;
    if (2 * b >= sum) return *this = {2 * a, 2 * b - sum, 2 * c}, 1;
    if (2 * c >= sum) return *this = {2 * a, 2 * b, 2 * c - sum}, 2;
    return *this = {sum - 2 * a, sum - 2 * b, sum - 2 * c}, 3;
  }
};

template <class T>
Section descend(unsigned octant, Barycentric<T> point, unsigned level) {
  Section section{0, octant};
  for (unsigned l = 0; l < level; ++l) section = section.child(point.descend());
  return section;
}

}  // namespace

SectionPlace place_of(Section section) {
  SectionPlace place;
  for (int l = section.level - 1; l >= 0; --l) {
    const unsigned child = section.index >> (2 * l) & 3;
    const std::int32_t far = place.inverted ? 1 : 0;
    if (child == 3)
      place = {2 * place.x + far, 2 * place.y + far, !place.inverted};
    else
      place = {2 * place.x + ((child == 0) != place.inverted ? 1 : 0),
               2 * place.y + ((child == 1) != place.inverted ? 1 : 0), place.inverted};
  }
  return place;
}

Section section_at(unsigned octant, SectionPlace place, unsigned level) {
  // The centroid, in thirds of a grid cell, is inside the section, so no ties occur.
  const std::int32_t shift = place.inverted ? 2 : 1;
  const std::int32_t a = 3 * place.x + shift;
  const std::int32_t b = 3 * place.y + shift;
  return descend<std::int64_t>(octant, {a, b, (3 << level) - a - b}, level);
}

Section locate_section(const glm::dvec3& direction, unsigned level) {
  const glm::dvec3 a = glm::abs(direction);
  return descend<double>(octant_of(direction), {a.x, a.y, a.z}, level);
}

Section owner_of(const LatticeVertex& vertex, unsigned level) {
  return descend<std::int64_t>(octant_of(vertex),
                               {std::abs(vertex.i), std::abs(vertex.j), std::abs(vertex.k)}, level);
}

LocalPoint to_local(OctantPoint point, Section section, std::uint32_t side) {
  const auto n = static_cast<std::int32_t>(side);
  const SectionPlace place = place_of(section);
  const std::int32_t p = place.inverted ? n * (place.x + 1) - point.x : point.x - n * place.x;
  const std::int32_t q = place.inverted ? n * (place.y + 1) - point.y : point.y - n * place.y;
  return {static_cast<std::uint16_t>(p), static_cast<std::uint16_t>(q)};
}

OctantPoint from_local(LocalPoint local, Section section, std::uint32_t side) {
  const auto n = static_cast<std::int32_t>(side);
  const SectionPlace place = place_of(section);
  if (place.inverted) return {n * (place.x + 1) - local.p, n * (place.y + 1) - local.q};
  return {n * place.x + local.p, n * place.y + local.q};
}

LatticeVertex vertex_at(Section section, LocalPoint local, std::uint32_t side) {
  return to_vertex(section.octant(), from_local(local, section, side),
                   static_cast<std::int32_t>(side) << section.level);
}

std::vector<LocalPoint> triangle_points(std::uint32_t side) {
  std::vector<LocalPoint> points;
  points.reserve(triangle_size(side));
  for (std::uint32_t q = 0; q <= side; ++q)
    for (std::uint32_t p = 0; p + q <= side; ++p)
      points.push_back({static_cast<std::uint16_t>(p), static_cast<std::uint16_t>(q)});
  return points;
}

std::vector<LocalPoint> owned_vertices(Section section, std::uint32_t side) {
  std::vector<LocalPoint> owned = triangle_points(side);
  std::erase_if(owned, [&](LocalPoint local) {
    return owner_of(vertex_at(section, local, side), section.level) != section;
  });
  return owned;
}

TileKey tile_key(const TileSections& sections) {
  const unsigned level = sections.exit.level;
  std::uint64_t index = sections.entry.octant() << 3 | sections.exit.octant();
  for (unsigned l = 1; l <= sections.entry.level; ++l) {
    index = index << 2 | (sections.entry.index >> (2 * (sections.entry.level - l)) & 3);
    if (l <= level) index = index << 2 | (sections.exit.index >> (2 * (level - l)) & 3);
  }
  return {static_cast<std::uint8_t>(level), index};
}

TileSections sections_of(TileKey key, unsigned entry_extra_levels) {
  const unsigned level = key.level;
  unsigned bit = 6 + 4 * level + 2 * entry_extra_levels;
  const auto take = [&](unsigned bits) {
    bit -= bits;
    return static_cast<std::uint32_t>(key.index >> bit & ((1u << bits) - 1));
  };
  TileSections sections;
  sections.entry = {0, take(3)};
  sections.exit = {0, take(3)};
  for (unsigned l = 1; l <= level + entry_extra_levels; ++l) {
    sections.entry = sections.entry.child(take(2));
    if (l <= level) sections.exit = sections.exit.child(take(2));
  }
  return sections;
}

std::vector<LatticeVertex> vertices_at(Section section, std::uint32_t side,
                                       std::span<const LocalPoint> locals) {
  std::vector<LatticeVertex> vertices;
  vertices.reserve(locals.size());
  for (const LocalPoint& local : locals) vertices.push_back(vertex_at(section, local, side));
  return vertices;
}

std::vector<glm::dvec3> world_points(const Sphere& sphere,
                                     std::span<const LatticeVertex> vertices) {
  std::vector<glm::dvec3> points;
  points.reserve(vertices.size());
  for (const LatticeVertex& vertex : vertices)
    points.push_back(sphere.center + sphere.radius * direction(vertex));
  return points;
}

}  // namespace slf
