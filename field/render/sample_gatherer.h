// SampleGatherer: copies the samples of a block's rays from tiles. Private to field/render.
//
// It finds the block's tiles in the cache's page table, mostly all of them, and gathers the
// samples. If the view waits, tiles that are not loaded are loaded in batches that fit its share of
// the memory, and samples are gathered from each batch in turn. Otherwise these tiles are
// unavailable, like tiles that were never built: rays that need one are drawn from a coarser level.
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "field/geometry/level_geometry.h"
#include "field/render/block_tiles.h"
#include "field/render/ray_block.h"
#include "field/tiles/tile_cache.h"
#include "slf/error.h"

namespace slf {

/// Reused from block to block. Thread-safety: one thread.
class SampleGatherer {
 public:
  /// Field and cache must outlive this. If a view waits, at most `pin_bytes` of decoded tiles are
  /// pinned at a time, but always one tile.
  SampleGatherer(const FieldFile& field, TileCache& cache, std::uint64_t pin_bytes);

  /// Begins a view. All of its threads share `frame`, which must outlive the view: a number of
  /// TileCache::begin_frame(), which this renews when it has waited for tiles. If `with_depth`, the
  /// view needs depths beside colours.
  void begin(std::atomic<std::uint32_t>& frame, bool with_depth);

  /// Gathers all samples of a pass over `count` rays from a level's tiles, and finds the rays that
  /// need an unavailable one, whose samples are 0. Errors of TileCache::load(), if `wait`.
  [[nodiscard]] Result<void> gather(const LevelGeometry& geometry, bool wait, std::size_t count,
                                    const EntryCells& entries, const Pass& pass);

  /// The samples of the last pass. The next gather() overwrites them.
  [[nodiscard]] BlockSamples& samples() { return samples_; }
  [[nodiscard]] bool half_floats() const { return is_half(format_); }
  /// Whether any ray of the last pass needs an unavailable tile, or a certain ray does.
  [[nodiscard]] bool any_unavailable() const { return tiles_.any_unavailable(); }
  [[nodiscard]] bool unavailable(std::size_t ray) const {
    return tile_offsets_.unavailable[ray] != 0;
  }

  /// The tiles that the view used so far, with repetitions, and those of them that were neither
  /// loaded nor waited for.
  [[nodiscard]] const std::vector<TileKey>& touched() const { return touched_; }
  [[nodiscard]] const std::vector<TileKey>& misses() const { return misses_; }

 private:
  [[nodiscard]] Result<void> gather_in_batches(std::size_t count, const EntryCells& entries,
                                               const Pass& pass);
  /// Gathers from the tiles that are loaded. If `add`, keeps the samples of earlier calls of the
  /// pass.
  void gather_loaded(std::size_t count, const EntryCells& entries, const Pass& pass, bool add);

  TileCache& cache_;
  TileCache::Reader reader_;
  std::atomic<std::uint32_t>* frame_ = nullptr;
  const codec::SampleFormat format_;
  const std::uint64_t pin_bytes_, max_tile_samples_;
  BlockTiles tiles_;
  TileOffsets tile_offsets_;
  BlockSamples samples_;
  std::vector<TileKey> touched_, misses_;
  // Keys in these lists, without repetitions, when they were last sorted.
  std::size_t unique_touched_ = 0, unique_misses_ = 0;
};

}  // namespace slf
