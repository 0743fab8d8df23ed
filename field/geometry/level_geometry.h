// LevelGeometry: tables that map a ray to its tile, row and columns at one level. Which level
// matches a picture.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "field/geometry/section.h"
#include "slf/shape.h"

namespace slf {

/// The coarsest level of a field whose lines from a vertex to two neighbours on the other side are
/// at most `spacing` apart at the sphere's centre, in radii; the finest level if none is. If
/// `aims`, as in mode depth, which corrects rays, lines to entry vertices may be twice as far
/// apart.
[[nodiscard]] unsigned matching_level(const FieldShape& shape, double spacing, bool aims);

/// The location of an entry vertex's samples: the section that owns the vertex, and the row of its
/// samples in that section's tiles.
struct EntryRow {
  std::uint32_t section = 0;  ///< index at the entry section level
  std::uint32_t row = 0;
};

/// Thread-safety: immutable.
class LevelGeometry {
 public:
  LevelGeometry(const FieldShape& shape, unsigned level);

  /// Bytes of memory that it takes, about.
  [[nodiscard]] static std::uint64_t memory(const FieldShape& shape, unsigned level) {
    const std::uint64_t n = shape.entry_resolution(level);
    return 8 * n * n * sizeof(std::uint32_t) + 4 * n * n * sizeof(LocalPoint);
  }

  [[nodiscard]] unsigned level() const { return level_; }
  [[nodiscard]] std::int32_t entry_resolution() const { return entry_resolution_; }
  [[nodiscard]] std::int32_t exit_resolution() const { return exit_resolution_; }
  [[nodiscard]] std::uint32_t exit_side() const { return exit_side_; }
  [[nodiscard]] Section entry_section(std::uint32_t index) const {
    return {static_cast<std::uint8_t>(entry_level_), index};
  }
  [[nodiscard]] Section exit_section(std::uint32_t index) const {
    return {static_cast<std::uint8_t>(level_), index};
  }

  /// The rows of the tiles of an entry section, as local coordinates. Valid as long as this object.
  [[nodiscard]] std::span<const LocalPoint> rows(std::uint32_t entry_section) const;

  /// The shape of the tiles of an entry section, with samples of this format.
  [[nodiscard]] TileShape tile(std::uint32_t entry_section, SampleFormat format) const {
    return {format, exit_side_, rows(entry_section)};
  }

  /// Finds an entry vertex, addressed from any octant that it touches.
  [[nodiscard]] EntryRow entry_row(unsigned octant, OctantPoint point) const {
    const std::uint32_t packed =
        entry_rows_[(octant * entry_stride_ + static_cast<std::uint32_t>(point.y)) * entry_stride_ +
                    static_cast<std::uint32_t>(point.x)];
    return {packed >> row_bits_, packed & ((1u << row_bits_) - 1)};
  }

  /// The table behind entry_row(): [octant][y][x], with entry_resolution() + 1 values of y and x.
  /// An entry is section << row_bits() | row.
  [[nodiscard]] std::span<const std::uint32_t> entry_rows() const { return entry_rows_; }
  [[nodiscard]] unsigned row_bits() const { return row_bits_; }
  /// The exit sections within an octant, [place]. Section (x, y, inverted) has the number
  /// i = (y · 2^level + x) · 2 + inverted. Half of the numbers up to last_number() lie beyond the
  /// octant's diagonal. The larger ones of the others take their places: a section's place is i or
  /// last_number() − i, whichever is less.
  [[nodiscard]] std::span<const std::uint32_t> exit_paths() const { return exit_paths_; }
  [[nodiscard]] std::uint32_t last_number() const { return (2u << 2 * level_) - 1; }

  /// The exit section that contains a cell, and the columns of the cell's corners in its tiles.
  struct ExitCell {
    std::uint32_t section = 0;
    std::array<std::uint32_t, 3> columns{};
  };
  [[nodiscard]] ExitCell exit_cell(const Cell& cell) const;

 private:
  [[nodiscard]] std::uint32_t place(std::uint32_t x, std::uint32_t y, bool inverted) const;

  unsigned level_, entry_level_;
  std::int32_t entry_resolution_, exit_resolution_;
  std::uint32_t exit_side_, entry_stride_;
  std::vector<LocalPoint> points_;        // rows of all sections, one after the other
  std::vector<std::uint32_t> row_begin_;  // per entry section, into points_; one more at the end
  unsigned row_bits_;
  std::vector<std::uint32_t> entry_rows_;  // [octant][y][x]
  std::vector<std::uint32_t> exit_paths_;  // section index within an octant
};

}  // namespace slf
