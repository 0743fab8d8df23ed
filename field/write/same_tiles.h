// Which tiles of a new field equal that of an earlier state. Internal.
#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <vector>

#include "field/geometry/tile_order.h"
#include "field/geometry/tile_selection.h"
#include "field/write/tile_source.h"

namespace slf {

/// Finds tiles that have the same samples in an earlier state. Keeps a hash of the samples of each
/// tile of a field; those that another thread makes, or that an earlier call of a build made, are
/// made again. The arguments of the constructor must outlive it. Thread-safety: any thread.
class SameTiles {
 public:
  /// `tiles`: those of the field.
  SameTiles(const TileSource& source, const TileOrder& order, const TileSelection& tiles,
            unsigned states)
      : source_(source), order_(order), tiles_(tiles), hashes_(states > 1 ? tiles.count() : 0) {}

  /// The tile of the first state that has the samples, so one that is stored: this tile itself if
  /// no earlier one has, or if it is not stored. Errors as the source.
  [[nodiscard]] Result<TileKey> find(const SourceTile& tile);

 private:
  using Hash = std::array<std::uint64_t, 2>;

  [[nodiscard]] Hash& hash(TileKey key) { return hashes_[tiles_.rank(order_.number(key))]; }
  Hash remember(const SourceTile& tile);
  Result<Hash> hash_of(TileKey key);

  const TileSource& source_;
  const TileOrder& order_;
  const TileSelection& tiles_;
  std::mutex mutex_;
  std::vector<Hash> hashes_;  // by the tile's rank; 0: not known
};

}  // namespace slf
