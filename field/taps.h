// Taps: the samples that rays take from tiles. Private to field/.
//
// A tap is what a ray needs of one entry vertex: up to three samples of one row of one tile. The
// tiles of a block's taps are pinned in waves that fit a budget, and each wave's samples taken;
// mostly one wave takes all, and its tiles stay pinned for the blocks that follow.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/error.h"
#include "field/level_geometry.h"
#include "field/ray_block.h"
#include "field/tile_cache.h"

namespace slf {

/// Reused from block to block. Thread-safety: one thread.
class TapGatherer {
 public:
  /// Pins at most `pin_bytes` of decoded tiles, or one tile. With depth, both layers are pinned.
  /// Unless it waits, tiles of levels above 0 that are not in the cache count as missing.
  TapGatherer(const Field& field, TileCache& cache, std::uint64_t pin_bytes, bool with_depth,
              bool wait);

  void resize(std::size_t rays);

  /// Takes all samples of a pass over `count` rays. `missing` is set, per ray, where a tile was
  /// never built or is not there yet.
  [[nodiscard]] Result<void> gather(const LevelGeometry& geometry, std::size_t count,
                                    const EntryArrays& entries, const Pass& pass);

  [[nodiscard]] const SampleArrays& samples() const { return samples_; }
  [[nodiscard]] bool missing(std::size_t ray) const { return missing_[ray] != 0; }
  [[nodiscard]] bool half_floats() const { return format_ == codec::SampleFormat::rgba16f; }

  /// Tiles touched since this was last cleared; with repetitions.
  [[nodiscard]] std::vector<TileKey>& touched() { return touched_; }
  /// Of them, those that were not waited for.
  [[nodiscard]] std::vector<TileKey>& wanted() { return wanted_; }

 private:
  struct Tap {
    std::uint32_t tile;  // number, in tiles_
    std::uint32_t row;   // its first sample
  };
  struct Tile {
    std::uint64_t sections;  // entry << 32 | exit
    TileKey key;
    TileCache::Pin color, depth;
  };
  struct TileSamples {
    const std::byte* colors = nullptr;  // null: nothing there
    const std::byte* depths = nullptr;
    bool missing = false;
  };
  /// Tiles [begin, end) of tiles_.
  struct Wave {
    std::uint32_t begin, end;
  };

  void number_tiles(std::size_t count, const EntryArrays& entries, const Pass& pass);
  [[nodiscard]] std::uint32_t number_of(std::uint64_t sections);
  void rehash(std::size_t slots);
  void forget_tiles();
  [[nodiscard]] Result<void> pin(Wave wave);
  [[nodiscard]] Result<void> pin(Tile& tile, TileSamples& samples, bool wait);
  void unpin(Wave wave);
  void take(Wave wave, std::size_t count, const Pass& pass);
  template <unsigned kExits, class Color>
  void take_typed(Wave wave, std::size_t count, const Pass& pass,
                  std::array<std::vector<Color>, 9>& colors);

  TileCache& cache_;
  storage::LayerId color_;
  std::optional<storage::LayerId> depth_;
  codec::SampleFormat format_;
  std::uint32_t most_pins_;
  bool wait_;
  const LevelGeometry* geometry_ = nullptr;  // whose tiles are in tiles_
  std::vector<Tile> tiles_;
  std::vector<TileSamples> tile_samples_;  // of tiles_, where pinned
  std::uint32_t pinned_ = 0;               // of tiles_, the first ones, that stay pinned
  std::vector<std::uint32_t> slots_;       // open-addressing table over tiles_
  std::array<std::vector<Tap>, 3> taps_;
  SampleArrays samples_;
  std::vector<std::uint8_t> missing_;
  std::vector<TileKey> touched_, wanted_;
};

}  // namespace slf
