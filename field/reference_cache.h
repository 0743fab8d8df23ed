// ReferenceCache: decoded tiles that others are predicted from, the least recently used dropped
// when they are too many. What is in use stays alive, dropped or not.
//
// Thread-safety: all members may be called from many threads. A tile is decoded once, by the
// thread that asks first; others wait for it. A tile's references are of a coarser level, so
// waiting ends.
#pragma once

#include <condition_variable>
#include <functional>
#include <list>
#include <mutex>
#include <unordered_map>

#include "field/predicted_tiles.h"

namespace slf {

class ReferenceCache {
 public:
  /// `load` decodes a tile.
  explicit ReferenceCache(ReferenceSource load) : load_(std::move(load)) {}

  [[nodiscard]] Result<TileSamples> get(TileKey key);

  /// Whether it is here, or on its way.
  [[nodiscard]] bool has(TileKey key);

  /// Bytes of decoded samples that are kept.
  void set_budget(std::uint64_t bytes);

 private:
  struct Entry {
    TileKey key;
    TileSamples samples;
    bool loading = true;
  };
  void evict_locked();

  ReferenceSource load_;
  std::mutex mutex_;
  std::condition_variable loaded_;
  std::list<Entry> entries_;  // least recently used first
  std::unordered_map<TileKey, std::list<Entry>::iterator, TileKeyHash> places_;
  std::uint64_t budget_ = 32ull << 20;
  std::uint64_t bytes_ = 0;
};

}  // namespace slf
