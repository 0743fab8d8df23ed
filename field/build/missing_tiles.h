// MissingTiles: what is left to build of a field.
#pragma once

#include <cstdint>
#include <vector>

#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "slf/error.h"

namespace slf {

/// The tiles that some layer lacks, by their numbers in key order: holes, and all tiles from some
/// number on.
class MissingTiles {
 public:
  /// All tiles, in all layers.
  explicit MissingTiles(const TileOrder& order) : tiles_(order.count()) {}

  /// Those of a field. bad_file: a record cannot be read.
  [[nodiscard]] static Result<MissingTiles> of(const FieldFile& field, const TileOrder& order);

  [[nodiscard]] std::uint64_t count() const { return holes_.size() + (tiles_ - end_); }
  /// The number of the k-th of them. REQUIRES: k < count().
  [[nodiscard]] std::uint64_t number(std::uint64_t k) const {
    return k < holes_.size() ? holes_[k].number : end_ + (k - holes_.size());
  }
  /// Whether a layer lacks the k-th. REQUIRES: k < count(), and one of the first 64 layers.
  [[nodiscard]] bool lacks(std::uint64_t k, storage::LayerId layer) const {
    return k >= holes_.size() || (holes_[k].layers >> layer & 1) != 0;
  }

 private:
  struct Hole {
    std::uint64_t number = 0;
    std::uint64_t layers = 0;  ///< a bit for each that lacks it
  };

  std::uint64_t tiles_;
  std::uint64_t end_ = 0;  ///< no layer has any tile from this number on
  std::vector<Hole> holes_;
};

}  // namespace slf
