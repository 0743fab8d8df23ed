// Which tiles of a build equal that of an earlier state. Internal.
#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <vector>

#include "field/geometry/tile_order.h"
#include "field/geometry/tile_selection.h"
#include "field/write/tile_tracer.h"

namespace slf {

/// Finds tiles that have the same samples in an earlier state. Keeps a hash of the samples of each
/// tile of a build; those that another thread makes, or that an earlier call of the build made, are
/// traced. The arguments of the constructor must outlive it. Thread-safety: any thread.
class SameTiles {
 public:
  /// `tiles`: those of the build, the same of each state.
  SameTiles(const TileTracer& tracer, const TileOrder& order, const TileSelection& tiles,
            unsigned states)
      : tracer_(tracer), order_(order), tiles_(tiles), hashes_(states > 1 ? tiles.count() : 0) {}

  /// How many states before that of the tile the first one is that has it; 0 if none has, or if
  /// the tile is empty. So the tile of the state that is found is stored. Errors as the tracer.
  [[nodiscard]] Result<std::uint64_t> find(const TracedTile& tile);

 private:
  using Hash = std::array<std::uint64_t, 2>;

  [[nodiscard]] Hash& hash(TileKey key) { return hashes_[tiles_.rank(order_.number(key))]; }
  Hash remember(const TracedTile& tile);
  Result<Hash> hash_of(TileKey key);

  const TileTracer& tracer_;
  const TileOrder& order_;
  const TileSelection& tiles_;
  std::mutex mutex_;
  std::vector<Hash> hashes_;  // by the tile's rank; 0: not known
};

}  // namespace slf
