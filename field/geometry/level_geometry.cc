#include "field/geometry/level_geometry.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <numbers>

namespace slf {

unsigned matching_level(const FieldShape& shape, double spacing, bool aims) {
  // Cells along an arc of π/2. At the centre, lines from one vertex are half as far apart.
  const double cells = std::min<double>(shape.exit_side, (aims ? 2.0 : 1.0) * shape.entry_side);
  double apart = std::numbers::pi / 4 / cells;
  unsigned level = 0;
  for (; level < shape.finest_level && apart > spacing; ++level) apart /= 2;
  return level;
}

LevelGeometry::LevelGeometry(const FieldShape& shape, unsigned level)
    : level_(level),
      entry_level_(level + shape.entry_extra_levels),
      entry_resolution_(static_cast<std::int32_t>(shape.entry_resolution(level))),
      exit_resolution_(static_cast<std::int32_t>(shape.exit_resolution(level))),
      exit_side_(shape.exit_side),
      entry_stride_(shape.entry_resolution(level) + 1),
      row_bits_(static_cast<unsigned>(std::bit_width(triangle_size(shape.entry_section_side())))) {
  // With lattices of at most 2^12 cells along an edge, section and row fit 32 bits.
  assert(3 + 2 * entry_level_ + row_bits_ <= 32);
  entry_rows_.resize(8ull * entry_stride_ * entry_stride_);
  points_.reserve(vertex_count(shape.entry_resolution(level)));
  row_begin_.push_back(0);
  const std::uint32_t side = shape.entry_section_side();
  for (std::uint32_t s = 0; s < section_count(entry_level_); ++s) {
    std::uint32_t row = 0;
    for (const LocalPoint& local : owned_vertices(entry_section(s), side)) {
      points_.push_back(local);
      const LatticeVertex v = vertex_at(entry_section(s), local, side);
      const OctantPoint at = to_octant_point(v);
      // A zero coordinate may have either sign, so enter the vertex for every octant it touches.
      const unsigned free = (v.i == 0 ? 1u : 0u) | (v.j == 0 ? 2u : 0u) | (v.k == 0 ? 4u : 0u);
      for (unsigned octant = 0; octant < 8; ++octant)
        if ((octant & ~free) == octant_of(v))
          entry_rows_[(octant * entry_stride_ + static_cast<std::uint32_t>(at.y)) * entry_stride_ +
                      static_cast<std::uint32_t>(at.x)] = s << row_bits_ | row;
      ++row;
    }
    row_begin_.push_back(static_cast<std::uint32_t>(points_.size()));
  }

  const std::uint32_t edge = 1u << level;
  exit_paths_.resize(std::size_t{edge} * edge);
  for (std::uint32_t y = 0; y < edge; ++y)
    for (std::uint32_t x = 0; x + y < edge; ++x)
      for (unsigned inverted = 0; inverted <= (x + y + 1 < edge ? 1u : 0u); ++inverted)
        exit_paths_[place(x, y, inverted != 0)] =
            section_at(0,
                       {static_cast<std::int32_t>(x), static_cast<std::int32_t>(y), inverted != 0},
                       level)
                .index;
}

std::uint32_t LevelGeometry::place(std::uint32_t x, std::uint32_t y, bool inverted) const {
  const std::uint32_t number = ((y << level_) + x) * 2 + (inverted ? 1 : 0);
  return std::min(number, last_number() - number);
}

std::span<const LocalPoint> LevelGeometry::rows(std::uint32_t entry_section) const {
  return {points_.data() + row_begin_[entry_section],
          row_begin_[entry_section + 1] - row_begin_[entry_section]};
}

LevelGeometry::ExitCell LevelGeometry::exit_cell(const Cell& cell) const {
  const std::uint32_t n = exit_side_;
  const auto x = static_cast<std::uint32_t>(cell.base.x);
  const auto y = static_cast<std::uint32_t>(cell.base.y);
  const std::uint32_t sx = x / n, sy = y / n;
  const std::uint32_t rx = x - sx * n, ry = y - sy * n;
  const bool inverted = rx + ry + (cell.inverted ? 1 : 0) >= n;

  ExitCell exit;
  exit.section = (cell.octant << (2 * level_)) | exit_paths_[place(sx, sy, inverted)];
  // Take the corner opposite the hypotenuse, then its neighbours along x and y. In an inverted
  // section local coordinates run backwards, so an upright cell is inverted there and vice versa.
  std::uint32_t p = rx, q = ry, step = 1;
  if (cell.inverted) p += 1, q += 1;
  if (inverted) p = n - p, q = n - q;
  if (cell.inverted != inverted) step = ~0u;  // towards smaller local coordinates
  exit.columns = {triangle_index(n, p, q), triangle_index(n, p + step, q),
                  triangle_index(n, p, q + step)};
  return exit;
}

}  // namespace slf
