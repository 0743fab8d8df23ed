// References: the vertices of the coarser entry lattice that a tile's rows are predicted from, and
// the tiles of the coarser level that have these vertices as rows (FORMAT.md, "Prediction").
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "field/geometry/level_geometry.h"
#include "slf/tile.h"

namespace slf {

/// What the tiles entered through one section are predicted from: the same for all exit sections.
struct References {
  struct Vertex {
    std::uint8_t slot = 0;  ///< index in `sections` of its owner
    std::uint32_t row = 0;  ///< in that section's tiles
    glm::vec3 direction{0.f};
  };
  struct Row {
    glm::vec3 direction{0.f};  ///< of the row's own vertex
    std::uint8_t count = 1;    ///< 1: the vertex is one of the coarser lattice; 2: between two
    Vertex vertex[2];
  };
  std::vector<Row> rows;
  /// The entry sections of the coarser level that own the references, ascending.
  std::vector<std::uint32_t> sections;
};

/// REQUIRES: finer.level() == coarser.level() + 1.
[[nodiscard]] References find_references(const LevelGeometry& coarser, const LevelGeometry& finer,
                                         std::uint32_t entry_section);

/// The tiles of the coarser level that a tile may refer to, as [slot][exit section]. There is a
/// slot for each of references.sections.
class Candidates {
 public:
  /// Of the tile with these sections, in its state. `coarser` and `references`, those of its entry
  /// section, must outlive this.
  Candidates(const LevelGeometry& coarser, const References& references, const TileSections& of,
             std::uint64_t state);

  [[nodiscard]] std::size_t size() const { return kinds_.size(); }
  [[nodiscard]] TileKey operator[](std::size_t k) const;
  /// The index of one; none if it is no candidate.
  [[nodiscard]] std::optional<std::size_t> find(TileKey key) const;
  /// What each has in common with the tile (codec::Predicted::kinds): 2 if their entry sections lie
  /// apart, plus 1 if their exit sections are in different octants.
  [[nodiscard]] const std::vector<std::uint8_t>& kinds() const { return kinds_; }

 private:
  const LevelGeometry& coarser_;
  const References& references_;
  std::size_t exits_;
  std::uint64_t state_;
  std::vector<std::uint8_t> kinds_;
};

/// The unit direction of a vertex, in floats that are the same on every machine: in doubles, one
/// rounding per operation, then rounded to float.
[[nodiscard]] glm::vec3 exact_direction(const LatticeVertex& vertex);

}  // namespace slf
