// Sphere and FieldShape: the plenoptic sphere, and how a field samples it.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "slf/error.h"
#include "slf/tile.h"

namespace slf {

/// The plenoptic sphere: centre and radius in world units.
struct Sphere {
  glm::dvec3 center{0.0};
  double radius = 1;
};

/// A cut. What lies on the side of the plane that its normal points to is removed; the face of the
/// cut is a surface.
struct ClipPlane {
  glm::dvec3 point{0.0};         ///< world
  glm::dvec3 normal{0, 0, 1.0};  ///< world, of any length but 0

  bool operator==(const ClipPlane&) const = default;
};

/// Where a line crosses a sphere: the parameters t of origin + t·direction, enter < leave. They are
/// negative behind the origin. `hit` is false if the line misses or only touches the sphere.
/// REQUIRES: direction is not zero.
struct Chord {
  bool hit = false;
  double enter = 0;
  double leave = 0;
};
[[nodiscard]] Chord intersect(const Sphere& sphere, const glm::dvec3& origin,
                              const glm::dvec3& direction);

/// How a field samples its sphere. Level l of the tile pyramid is a complete field on entry
/// lattice(entry_side·2^l) and exit lattice(exit_side·2^l).
struct FieldShape {
  static constexpr std::uint32_t kMaxSide = 1024;  ///< largest entry_side and exit_side

  Sphere sphere{.center = glm::dvec3(0), .radius = 0};  ///< radius 0: not chosen yet
  std::uint32_t entry_side = 8;     ///< cells along an octsphere's edge at level 0, entry side
  std::uint32_t exit_side = 32;     ///< the same, exit side; also the side of every tile's pictures
  unsigned finest_level = 2;        ///< the finest level, 0 to 10: levels 0 to it are stored
  unsigned entry_extra_levels = 0;  ///< splits of entry sections beyond those of exit sections
  /// The level-0 subfields of the field, ascending: 8 × entry octant + exit octant. Empty: all 64.
  /// With entry_extra_levels > 0 they are still pairs of octants.
  std::vector<std::uint8_t> subfields;
  unsigned states = 1;  ///< variants of the object on this sphere, 1 to kMaxStates

  [[nodiscard]] std::uint32_t entry_resolution(unsigned level) const { return entry_side << level; }
  [[nodiscard]] std::uint32_t exit_resolution(unsigned level) const { return exit_side << level; }
  /// Cells along the edge of an entry section: entry_side / 2^entry_extra_levels.
  [[nodiscard]] std::uint32_t entry_section_side() const {
    return entry_side >> entry_extra_levels;
  }
  /// Rays of one level and state, with all subfields: entry vertices × exit vertices.
  [[nodiscard]] std::uint64_t slabs(unsigned level) const;
  /// Tiles of one level in the complete field, of all states.
  [[nodiscard]] std::uint64_t tiles(unsigned level) const;
  /// Whether the complete field has a tile with this key.
  [[nodiscard]] bool has(TileKey key) const;
  /// The largest number of samples in a tile.
  [[nodiscard]] std::uint64_t max_tile_samples() const;

  /// usage: a side, level, subfield or the sphere is out of range, or tiles would have more than
  /// 2^24 samples. The message states what is valid.
  [[nodiscard]] Result<void> check() const;
};

}  // namespace slf
