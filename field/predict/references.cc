#include "field/predict/references.h"

#include <algorithm>
#include <cmath>

#include "base/sort_unique.h"

namespace slf {
namespace {

/// The vertices of the coarser lattice at or around `v`: v / 2, or the two that v / 2 lies between.
/// The resolution is even, so none or two of the coordinates are odd. If two are odd, one of them
/// moves by 1 away from 0 and the other by 1 towards 0, or the other way around.
std::vector<LatticeVertex> parents_of(const LatticeVertex& v) {
  std::int32_t at[3] = {v.i, v.j, v.k};
  std::size_t odd[2] = {};
  std::size_t count = 0;
  for (std::size_t axis = 0; axis < 3; ++axis)
    if (at[axis] % 2 != 0) odd[count++] = axis;
  if (count == 0) return {{v.i / 2, v.j / 2, v.k / 2}};
  const auto moved = [&](std::int32_t by) {
    std::int32_t to[3] = {at[0], at[1], at[2]};
    to[odd[0]] += at[odd[0]] > 0 ? by : -by;
    to[odd[1]] -= at[odd[1]] > 0 ? by : -by;
    return LatticeVertex{to[0] / 2, to[1] / 2, to[2] / 2};
  };
  return {moved(1), moved(-1)};
}

}  // namespace

glm::vec3 exact_direction(const LatticeVertex& v) {
  const double i = v.i, j = v.j, k = v.k;
  const double length = std::sqrt(i * i + j * j + k * k);
  return {static_cast<float>(i / length), static_cast<float>(j / length),
          static_cast<float>(k / length)};
}

References find_references(const LevelGeometry& coarser, const LevelGeometry& finer,
                           std::uint32_t entry_section) {
  References found;
  const Section section = finer.entry_section(entry_section);
  const auto side = static_cast<std::uint32_t>(finer.entry_resolution()) >> section.level;
  std::vector<std::uint32_t> owners;  // of the references, row by row
  for (const LocalPoint& local : finer.rows(entry_section)) {
    const LatticeVertex vertex = vertex_at(section, local, side);
    References::Row row;
    row.direction = exact_direction(vertex);
    row.count = 0;
    for (const LatticeVertex& parent : parents_of(vertex)) {
      const EntryRow at = coarser.entry_row(octant_of(parent), to_octant_point(parent));
      owners.push_back(at.section);
      row.vertex[row.count++] = {0, at.row, exact_direction(parent)};
    }
    found.rows.push_back(row);
  }
  found.sections = owners;
  sort_unique(found.sections);
  auto owner = owners.begin();
  for (References::Row& row : found.rows)
    for (std::size_t c = 0; c < row.count; ++c) {
      const auto at = std::lower_bound(found.sections.begin(), found.sections.end(), *owner++);
      row.vertex[c].slot = static_cast<std::uint8_t>(at - found.sections.begin());
    }
  return found;
}

Candidates::Candidates(const LevelGeometry& coarser, const References& references,
                       const TileSections& of, std::uint64_t state)
    : coarser_(coarser),
      references_(references),
      exits_(section_count(coarser.level())),
      state_(state) {
  kinds_.reserve(references.sections.size() * exits_);
  for (const std::uint32_t slot : references.sections) {
    const int far_entry = coarser.entry_section(slot) != of.entry.parent() ? 2 : 0;
    for (std::uint32_t exit = 0; exit < exits_; ++exit) {
      const bool far_exit = coarser.exit_section(exit).octant() != of.exit.octant();
      kinds_.push_back(static_cast<std::uint8_t>(far_entry + (far_exit ? 1 : 0)));
    }
  }
}

TileKey Candidates::operator[](std::size_t k) const {
  const TileKey first = tile_key({coarser_.entry_section(references_.sections[k / exits_]),
                                  coarser_.exit_section(static_cast<std::uint32_t>(k % exits_))});
  return in_state(first, state_);
}

std::optional<std::size_t> Candidates::find(TileKey key) const {
  if (key.level != coarser_.level()) return std::nullopt;
  const TileSections at = sections_of(key, coarser_.entry_section(0).level - coarser_.level());
  const auto& slots = references_.sections;
  const auto slot = std::lower_bound(slots.begin(), slots.end(), at.entry.index);
  if (slot == slots.end() || *slot != at.entry.index) return std::nullopt;
  return static_cast<std::size_t>(slot - slots.begin()) * exits_ + at.exit.index;
}

}  // namespace slf
