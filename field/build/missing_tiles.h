// MissingTiles: what is left to build of a field.
#pragma once

#include <cstdint>
#include <vector>

#include "field/build/tile_selection.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "slf/error.h"

namespace slf {

/// The tiles that some layer lacks of those that are to be built, by their numbers in key order:
/// holes, and all tiles from some number on.
class MissingTiles {
 public:
  /// All of a selection, in all layers.
  explicit MissingTiles(TileSelection wanted) : wanted_(std::move(wanted)) {}

  /// Those that a field lacks. bad_file: a record cannot be read.
  [[nodiscard]] static Result<MissingTiles> of(const FieldFile& field, const TileOrder& order,
                                               TileSelection wanted);

  [[nodiscard]] std::uint64_t count() const { return holes_.size() + (wanted_.count() - end_); }
  /// The number of the k-th of them. REQUIRES: k < count().
  [[nodiscard]] std::uint64_t number(std::uint64_t k) const {
    return wanted_.number(k < holes_.size() ? holes_[k].rank : end_ + (k - holes_.size()));
  }
  /// Whether a layer lacks the k-th. REQUIRES: k < count(), and one of the first 64 layers.
  [[nodiscard]] bool lacks(std::uint64_t k, storage::LayerId layer) const {
    return k >= holes_.size() || (holes_[k].layers >> layer & 1) != 0;
  }

 private:
  struct Hole {
    std::uint64_t rank = 0;    ///< among those wanted
    std::uint64_t layers = 0;  ///< a bit for each that lacks it
  };

  TileSelection wanted_;
  std::uint64_t end_ = 0;  ///< no layer has any of those wanted from this rank on
  std::vector<Hole> holes_;
};

}  // namespace slf
