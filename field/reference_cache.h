// ReferenceCache: a cache of decoded tiles that others are predicted from. It evicts the least
// recently used ones; samples in use stay alive after that.
//
// Thread-safety: all members may be called from many threads. The first thread that requests a tile
// decodes it, and others wait for it. Decoding may request tiles of coarser levels only, so there
// is no deadlock.
#pragma once

#include <condition_variable>
#include <functional>
#include <list>
#include <mutex>
#include <unordered_map>

#include "field/predicted_tiles.h"

namespace slf {

/// The decoded samples of a tile; null if the tile is empty.
using TileSamples = std::shared_ptr<const Bytes>;

class ReferenceCache {
 public:
  using Load = std::function<Result<TileSamples>(TileKey)>;
  /// `load` decodes a tile.
  explicit ReferenceCache(Load load) : load_(std::move(load)) {}

  /// The samples of a tile, decoded if necessary. Errors and exceptions of `load` are passed on,
  /// and not cached.
  [[nodiscard]] Result<TileSamples> get(TileKey key);

  /// Whether a tile is cached or being decoded.
  [[nodiscard]] bool has(TileKey key);

  /// Limits the bytes of cached samples.
  void set_budget(std::uint64_t bytes);

 private:
  struct Entry {
    TileKey key;
    TileSamples samples;
    bool loading = true;
  };
  void evict_locked();

  Load load_;
  std::mutex mutex_;
  std::condition_variable loaded_;
  std::list<Entry> entries_;  // least recently used first
  std::unordered_map<TileKey, std::list<Entry>::iterator, TileKeyHash> places_;
  std::uint64_t budget_ = 32ull << 20;
  std::uint64_t bytes_ = 0;
};

}  // namespace slf
