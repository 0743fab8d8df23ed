// BlockTiles: the tiles that a block's rays sample in one pass, numbered as they are met. Private
// to field/render.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "field/geometry/level_geometry.h"
#include "field/render/page_table.h"
#include "field/render/ray_block.h"
#include "slf/tile.h"

namespace slf {

/// Stands for no tile: an entry vertex of weight 0 takes no samples.
inline constexpr std::uint32_t kNoTile = ~0u;

/// Which tile, by number, each entry vertex of each ray samples, or kNoTile.
using TileNumbers = std::array<RayArray<std::uint32_t>, 3>;

/// Where the samples of tiles begin: bytes from `zeros`, by tile number + 1, so that kNoTile has
/// the first. 0 stands for samples that are all 0; zeros surround `zeros` as far as one load
/// reaches.
struct TileOffsets {
  const std::byte* zeros = nullptr;
  std::vector<std::int64_t> color{0}, depth{0};
};

/// Thread-safety: one thread.
class BlockTiles {
 public:
  /// How a tile was found.
  enum class State : std::uint8_t {
    available,  ///< its samples can be read, or are all 0
    absent,     ///< not loaded
    missing,    ///< never built
  };
  struct Tile {
    std::uint32_t entry = 0, exit = 0;  ///< section indices
    State state = State::absent;
    TilePage* page = nullptr;  ///< as look_up() found it, loaded or not
  };

  BlockTiles();
  BlockTiles(const BlockTiles&) = delete;
  BlockTiles& operator=(const BlockTiles&) = delete;

  /// Begins a pass, without tiles.
  void clear() { tiles_.clear(); }

  /// The number of a tile. One that was met long ago may get another. Not inlined: the kernel's
  /// loop, which calls it rarely, keeps its registers.
  [[gnu::noinline]] std::uint32_t number(std::uint32_t entry, std::uint32_t exit) {
    std::uint32_t& recent = recent_[(5 * entry + exit) % kRecent];
    if (recent < tiles_.size() && tiles_[recent].entry == entry && tiles_[recent].exit == exit)
      return recent;
    tiles_.push_back({entry, exit});
    return recent = static_cast<std::uint32_t>(tiles_.size() - 1);
  }

  /// Looks up all tiles in their level's table. The keys of those that `frame` has not used yet are
  /// appended to `touched`. REQUIRES: a ReadScope until the samples are gathered.
  void look_up(const LevelGeometry& geometry, const PageTable& table, std::uint32_t frame,
               bool with_depth, std::vector<TileKey>& touched);

  /// Gives a tile its page, which is loaded.
  void set_page(std::uint32_t number, const TilePage& page);
  /// Makes a tile absent.
  void clear_page(std::uint32_t number) {
    clear_offset(number);
    tiles_[number].state = State::absent;
  }
  /// Takes a tile's samples for 0 from now on; its state stays.
  void clear_offset(std::uint32_t number) {
    offsets_.color[number + 1] = offsets_.depth[number + 1] = 0;
  }

  [[nodiscard]] const std::vector<Tile>& tiles() const { return tiles_; }
  [[nodiscard]] const TileOffsets& offsets() const { return offsets_; }
  /// Whether any tile was absent, or missing, when it was looked up.
  [[nodiscard]] bool any_absent() const { return any_absent_; }
  [[nodiscard]] bool any_missing() const { return any_missing_; }

 private:
  static constexpr std::uint32_t kRecent = 64;

  void set_page(std::uint32_t number, const TilePage& page, std::uint32_t layers);
  [[nodiscard]] std::int64_t offset_of(const std::byte* samples) const;

  bool with_depth_ = false;
  bool any_absent_ = false, any_missing_ = false;
  std::vector<Tile> tiles_;
  std::array<std::uint32_t, kRecent> recent_{};  // numbers, by hash of the sections
  TileOffsets offsets_;
  std::array<std::byte, 24> zeros_{};
};

}  // namespace slf
