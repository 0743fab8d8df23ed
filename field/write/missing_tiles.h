// MissingTiles: the tiles of a field that remain to be built.
#pragma once

#include <cstdint>
#include <vector>

#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/geometry/tile_selection.h"
#include "slf/error.h"

namespace slf {

/// The selected tiles that are missing, by their numbers in key order: holes among stored tiles,
/// and all selected tiles after the last stored one.
class MissingTiles {
 public:
  /// All selected tiles.
  explicit MissingTiles(TileSelection selection) : selection_(std::move(selection)) {}

  /// The selected tiles that are missing in a field. bad_file: a record cannot be read.
  [[nodiscard]] static Result<MissingTiles> of(const FieldFile& field, const TileOrder& order,
                                               TileSelection selection);

  [[nodiscard]] std::uint64_t count() const { return holes_.size() + (selection_.count() - end_); }
  /// The number of the k-th missing tile. REQUIRES: k < count().
  [[nodiscard]] std::uint64_t number(std::uint64_t k) const {
    return selection_.number(k < holes_.size() ? holes_[k] : end_ + (k - holes_.size()));
  }
  /// The numbers of all missing tiles.
  [[nodiscard]] TileSelection numbers() const;

 private:
  TileSelection selection_;
  std::uint64_t end_ = 0;             ///< selected tiles from this rank on are missing
  std::vector<std::uint64_t> holes_;  ///< ranks among the selected tiles
};

}  // namespace slf
