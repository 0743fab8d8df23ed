// Taps: the samples that rays take from tiles. Private to field/.
//
// A tap is what a ray needs of one entry vertex: three samples of one row of one tile. The
// tiles of a block's taps are pinned in waves that fit a budget, and each wave's samples taken;
// mostly one wave takes all, and its tiles stay pinned for the blocks that follow.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "field/geometry/level_geometry.h"
#include "field/render/ray_block.h"
#include "field/render/tile_cache.h"
#include "field/render/tile_numbers.h"
#include "slf/error.h"

namespace slf {

/// Sorts keys and drops repetitions.
void sort_unique(std::vector<TileKey>& keys);

/// The tiles that were gathered for a picture, still pinned: the next one needs mostly the same.
/// Must not outlive the cache.
struct KeptTiles {
  struct Tile {
    TileKey key;
    TileCache::Pin pin;
    bool missing;  ///< or not there yet
  };
  TileNumbers numbers;
  std::vector<Tile> tiles;  ///< by number
  bool with_depth = false;
};

/// Reused from block to block. Thread-safety: one thread.
class TapGatherer {
 public:
  /// With depth, both layers of tiles are pinned. One that waits pins at most `pin_bytes` of
  /// decoded tiles, or one tile; for one that does not, tiles that are not in the cache count as
  /// missing, and those of `earlier` need not be looked for.
  TapGatherer(const FieldFile& field, TileCache& cache, std::uint64_t pin_bytes, bool with_depth,
              bool wait, KeptTiles earlier = {});
  TapGatherer(const TapGatherer&) = delete;
  TapGatherer& operator=(const TapGatherer&) = delete;
  ~TapGatherer();

  /// The end: what this one gathered. REQUIRES: it does not wait.
  [[nodiscard]] KeptTiles keep() &&;

  void resize(std::size_t rays);

  /// Takes all samples of a pass over `count` rays. `missing` becomes set, per ray, where a tile
  /// was never built or is not there yet.
  [[nodiscard]] Result<void> gather(const LevelGeometry& geometry, std::size_t count,
                                    const EntryArrays& entries, const Pass& pass);

  [[nodiscard]] const SampleArrays& samples() const { return samples_; }
  void forget_missing() { any_missing_ = false; }
  [[nodiscard]] bool any_missing() const { return any_missing_; }
  [[nodiscard]] bool missing(std::size_t ray) const { return any_missing_ && missing_[ray] != 0; }
  [[nodiscard]] bool half_floats() const { return format_ == codec::SampleFormat::rgba16f; }

  /// Tiles touched since this was last cleared; with repetitions.
  [[nodiscard]] std::vector<TileKey>& touched() { return touched_; }
  /// Of them, those that were not waited for.
  [[nodiscard]] std::vector<TileKey>& wanted() { return wanted_; }

 private:
  using Tile = KeptTiles::Tile;
  /// Tiles [begin, end) of tiles_.
  struct Wave {
    std::uint32_t begin, end;
  };

  void release(std::span<Tile> tiles);
  void forget_tiles();
  void add_tiles();
  [[nodiscard]] Result<void> pin(Wave wave);
  /// Holds what is pinned already or in the cache; returns the numbers of the others.
  [[nodiscard]] std::vector<std::uint32_t> find(Wave wave);
  [[nodiscard]] Result<void> load(std::span<const std::uint32_t> numbers);
  void hold(std::uint32_t number, TileCache::Pin pin);
  void unpin(Wave wave);
  void take(Wave wave, std::size_t count, const EntryArrays& entries, const Pass& pass, bool add);
  [[nodiscard]] std::int64_t offset_of(const std::byte* samples) const;

  TileCache& cache_;
  codec::SampleFormat format_;
  bool with_depth_;
  std::uint32_t most_pins_;
  bool wait_;
  KeptTiles earlier_;
  const LevelGeometry* geometry_ = nullptr;  // whose tiles are in tiles_
  TileNumbers numbers_;
  std::vector<Tile> tiles_;   // by number
  std::uint32_t pinned_ = 0;  // of tiles_, the first ones, that stay pinned
  std::array<std::byte, TileCache::kBefore + 16> zeros_{};  // as far around as samples are loaded
  TileOffsets offsets_;
  TileArrays taps_;
  SampleArrays samples_;
  bool lacks_tiles_ = false;  // some of tiles_ are missing
  bool any_missing_ = false;  // some of missing_ are set
  std::vector<std::uint8_t> missing_;
  std::vector<TileKey> touched_, wanted_;
  std::size_t touched_once_ = 0;  // of touched_, without repetitions, when last looked at
};

}  // namespace slf
