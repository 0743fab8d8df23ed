// SampleGatherer: takes the samples of a block's rays out of tiles. Private to field/render.
//
// It looks the block's tiles up in the cache's page table, mostly finds all of them, and gathers
// the samples. A view that waits loads the tiles it lacks, in batches that fit its share of the
// memory, and gathers from each batch in turn. In one that does not wait these tiles are
// unavailable, as tiles that were never built always are: rays that need one are drawn from a
// coarser level.
#pragma once

#include <cstdint>
#include <vector>

#include "field/geometry/level_geometry.h"
#include "field/render/block_tiles.h"
#include "field/render/ray_block.h"
#include "field/render/tile_cache.h"
#include "slf/error.h"

namespace slf {

/// Sorts keys and drops repetitions.
void sort_unique(std::vector<TileKey>& keys);

/// Reused from block to block. Thread-safety: one thread.
class SampleGatherer {
 public:
  /// Borrows all. Where it waits, it pins at most `pin_bytes` of decoded tiles, or one tile. Blocks
  /// have at most `most_rays`.
  SampleGatherer(const FieldFile& field, TileCache& cache, std::uint64_t pin_bytes,
                 std::size_t most_rays);

  /// Begins a view. `frame` is of TileCache::begin_frame(). With depth, both layers are needed.
  void begin(std::uint32_t frame, bool with_depth);

  /// Gathers all samples of a pass over `count` rays from a level's tiles, and finds the rays that
  /// need an unavailable one, whose samples are 0.
  [[nodiscard]] Result<void> gather(const LevelGeometry& geometry, bool wait, std::size_t count,
                                    const EntryCells& entries, const Pass& pass);

  [[nodiscard]] const BlockSamples& samples() const { return samples_; }
  [[nodiscard]] bool half_floats() const { return format_ == codec::SampleFormat::rgba16f; }
  /// Whether any ray of the last pass needs an unavailable tile; whether one of them does.
  [[nodiscard]] bool any_unavailable() const { return tiles_.any_unavailable(); }
  [[nodiscard]] bool unavailable(std::size_t ray) const { return begins_.unavailable[ray] != 0; }

  /// The tiles that the view used so far, with repetitions; of them, those that were absent and not
  /// waited for.
  [[nodiscard]] const std::vector<TileKey>& touched() const { return touched_; }
  [[nodiscard]] const std::vector<TileKey>& wanted() const { return wanted_; }

 private:
  [[nodiscard]] Result<void> gather_in_batches(std::size_t count, const EntryCells& entries,
                                               const Pass& pass);
  /// Gathers from the tiles that are loaded; `add` to what earlier calls of the pass gathered.
  void gather_loaded(std::size_t count, const EntryCells& entries, const Pass& pass, bool add);
  void add_wanted();

  TileCache& cache_;
  TileCache::Reader reader_;
  const codec::SampleFormat format_;
  const std::uint64_t pin_bytes_, largest_tile_;
  bool with_depth_ = false;
  BlockTiles tiles_;
  TileBegins begins_;
  BlockSamples samples_;
  std::vector<TileKey> touched_, wanted_;
  std::size_t wanted_once_ = 0;  // of wanted_, without repetitions, when it was last sorted
};

}  // namespace slf
