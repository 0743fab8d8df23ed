// Section: a spherical triangle of the hierarchical subdivision. A tile pairs two of them.
//
// The 8 octspheres are the sections of level 0. A section is split into four by three great arcs
// through its edge midpoints (paper Figure 9): child 0, 1, 2 at the corner of its first, second,
// third barycentric coordinate, child 3 in the middle. In the u,v plane a section is a
// sub-triangle of the lattice, either upright or, after an odd number of middles, inverted.
//
// Inside a section, points have local coordinates (p, q), p + q <= n, where n is the number of
// lattice cells along its edge: its own barycentric coordinates times n.
#pragma once

#include <compare>
#include <cstdint>
#include <span>
#include <vector>

#include "base/tile_shape.h"
#include "field/geometry/lattice.h"
#include "slf/shape.h"
#include "slf/tile.h"

namespace slf {

/// The deepest level a section can have; index then needs 3 + 2·12 bits.
inline constexpr unsigned kMaxSectionLevel = 12;

/// A section by its level and its index in [0, 8·4^level): the octant, then two bits for each
/// child on the way down. The children of index s are 4s..4s+3: they tile their parent.
struct Section {
  std::uint8_t level = 0;
  std::uint32_t index = 0;
  friend auto operator<=>(const Section&, const Section&) = default;

  [[nodiscard]] unsigned octant() const { return index >> (2 * level); }
  [[nodiscard]] Section parent() const {
    return {static_cast<std::uint8_t>(level - 1), index >> 2};
  }
  [[nodiscard]] Section child(unsigned c) const {
    return {static_cast<std::uint8_t>(level + 1), index << 2 | c};
  }
};

[[nodiscard]] constexpr std::uint64_t section_count(unsigned level) { return 8ull << (2 * level); }

/// A section's place in its octsphere: the sub-triangle with corners (x,y), (x+1,y), (x,y+1) when
/// upright and (x+1,y+1), (x,y+1), (x+1,y) when inverted, on the grid with 2^level cells an edge.
struct SectionPlace {
  std::int32_t x = 0;
  std::int32_t y = 0;
  bool inverted = false;
  friend bool operator==(const SectionPlace&, const SectionPlace&) = default;
};

[[nodiscard]] SectionPlace place_of(Section section);
[[nodiscard]] Section section_at(unsigned octant, SectionPlace place, unsigned level);

/// The section of `level` that contains a direction. On shared arcs, the tie rule of owner_of()
/// applies.
[[nodiscard]] Section locate_section(const glm::dvec3& direction, unsigned level);

/// The one section of `level` that owns a vertex, in integer arithmetic. Tie rule: a zero
/// coordinate counts as positive. On an arc between children, the owner is the child with the
/// lowest number: the corner of the first coordinate, then the second, the third, and last the
/// middle. REQUIRES: the lattice's resolution is a multiple of 2^level.
[[nodiscard]] Section owner_of(const LatticeVertex& vertex, unsigned level);

/// Local coordinates of a grid point in a section, and back. REQUIRES: the point is in the section
/// or on its border.
[[nodiscard]] LocalPoint to_local(OctantPoint point, Section section, std::uint32_t side);
[[nodiscard]] OctantPoint from_local(LocalPoint local, Section section, std::uint32_t side);

/// The vertex of a section at local coordinates, and its direction on the unit sphere.
[[nodiscard]] LatticeVertex vertex_at(Section section, LocalPoint local, std::uint32_t side);
[[nodiscard]] std::vector<LatticeVertex> vertices_at(Section section, std::uint32_t side,
                                                     std::span<const LocalPoint> locals);
/// Where vertices are on a sphere: the ends of rays.
[[nodiscard]] std::vector<glm::dvec3> world_points(const Sphere& sphere,
                                                   std::span<const LatticeVertex> vertices);

/// All local coordinates of a section with `side` cells an edge, in ascending (q, p): the columns
/// of a tile that exits through it.
[[nodiscard]] std::vector<LocalPoint> triangle_points(std::uint32_t side);

/// The local coordinates of the vertices that a section owns, in ascending (q, p): the rows of a
/// tile entered through it.
[[nodiscard]] std::vector<LocalPoint> owned_vertices(Section section, std::uint32_t side);

/// A tile's two sections. At level l the exit section has level l, and the entry section has level
/// l + entry_extra_levels (FieldShape; 0 in the paper).
struct TileSections {
  Section entry;
  Section exit;
  friend bool operator==(const TileSections&, const TileSections&) = default;
};

/// Converts sections to a key and back. The index has, from the highest bit: entry and exit octant
/// (3+3 bits), entry and exit child of each level (2+2 bits), and the children of the extra entry
/// levels (2 bits each). So the tiles of a subfield are a contiguous range of keys.
[[nodiscard]] TileKey tile_key(const TileSections& sections);
[[nodiscard]] TileSections sections_of(TileKey key, unsigned entry_extra_levels);

/// Tiles of one level: 64·16^level·4^entry_extra_levels.
[[nodiscard]] constexpr std::uint64_t tile_count(unsigned level, unsigned entry_extra_levels) {
  return 64ull << (4 * level + 2 * entry_extra_levels);
}

}  // namespace slf
