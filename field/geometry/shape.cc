#include "slf/shape.h"

#include <algorithm>
#include <cmath>

#include "field/geometry/section.h"

namespace slf {
namespace {

constexpr std::uint64_t kMaxTileSamples = 1ull << 24;  // 64 MiB of RGBA
constexpr std::uint32_t kMaxResolution = 4096;
constexpr double kMaxLength = 1e12;  // so that no product of lengths overflows

}  // namespace

std::uint64_t FieldShape::slabs(unsigned level) const {
  return vertex_count(entry_resolution(level)) * vertex_count(exit_resolution(level));
}

std::uint64_t FieldShape::tiles(unsigned level) const {
  const std::uint64_t all = tile_count(level, entry_extra_levels);
  return states * (subfields.empty() ? all : all / 64 * subfields.size());
}

std::uint64_t FieldShape::max_tile_samples() const {
  return std::uint64_t{triangle_size(entry_section_side())} * triangle_size(exit_side);
}

bool FieldShape::has(TileKey key) const {
  if (key.level > finest_level || key.state >= states ||
      key.index >= tile_count(key.level, entry_extra_levels))
    return false;
  const auto subfield =
      static_cast<std::uint8_t>(key.index >> (4 * key.level + 2 * entry_extra_levels));
  return subfields.empty() || std::binary_search(subfields.begin(), subfields.end(), subfield);
}

Result<void> FieldShape::check() const {
  if (entry_side < 1 || entry_side > kMaxSide || exit_side < 1 || exit_side > kMaxSide)
    return fail(ErrorCode::usage, "entry ", entry_side, ", exit ", exit_side, ": expected 1 to ",
                kMaxSide, " cells along an octsphere's edge");
  if (finest_level > 10)
    return fail(ErrorCode::usage, "levels ", finest_level, ": expected at most 10");
  if (states < 1 || states > kMaxStates)
    return fail(ErrorCode::usage, states, " states: expected 1 to ", kMaxStates);
  if (entry_extra_levels > kMaxSectionLevel - finest_level)
    return fail(ErrorCode::usage, "entry extra levels ", entry_extra_levels, ": expected at most ",
                kMaxSectionLevel - finest_level);
  if (entry_resolution(finest_level) > kMaxResolution ||
      exit_resolution(finest_level) > kMaxResolution)
    return fail(ErrorCode::usage, "lattice ", entry_resolution(finest_level), "/",
                exit_resolution(finest_level), ": expected at most ", kMaxResolution);
  if (entry_section_side() << entry_extra_levels != entry_side)
    return fail(ErrorCode::usage, "entry ", entry_side, " cannot be split ", entry_extra_levels,
                " levels deeper: expected a multiple of ", 1u << entry_extra_levels);
  if (max_tile_samples() > kMaxTileSamples)
    return fail(ErrorCode::usage, "entry ", entry_side, ", exit ", exit_side,
                ": a tile would have ", max_tile_samples(), " samples, at most ", kMaxTileSamples,
                " are allowed; halve both sides and add a level");
  for (std::size_t k = 0; k < subfields.size(); ++k)
    if (subfields[k] > 63 || (k > 0 && subfields[k] <= subfields[k - 1]))
      return fail(ErrorCode::usage,
                  "subfields: expected different numbers from 0 to 63, ascending");
  const glm::dvec3& c = sphere.center;
  for (int axis = 0; axis < 3; ++axis)
    if (!(std::abs(c[axis]) <= kMaxLength))
      return fail(ErrorCode::usage, "sphere: centre ", c.x, ",", c.y, ",", c.z,
                  ": expected coordinates of at most ", kMaxLength);
  if (!(sphere.radius >= 1 / kMaxLength && sphere.radius <= kMaxLength))
    return fail(ErrorCode::usage, "sphere: radius ", sphere.radius, ": expected ", 1 / kMaxLength,
                " to ", kMaxLength);
  return {};
}

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
