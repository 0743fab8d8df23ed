// BlockTiles: the tiles that a block's rays sample in one pass. Private to field/render.
//
// The kernel (gather_kernel.h) itself finds tiles that have the frame's number, a vector of them at
// a time. It calls find() for the others: tiles that the frame uses for the first time, or again
// after it has waited, and tiles that are not loaded.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "field/geometry/level_geometry.h"
#include "field/render/ray_block.h"
#include "field/tiles/page_table.h"
#include "slf/tile.h"

namespace slf {

/// Where the samples of each ray's tiles begin, by entry vertex, as sample_offset(). 0 stands for
/// samples that are all 0: of an empty tile, of no tile, or of a vertex of weight 0.
struct TileOffsets {
  std::array<RayArray<std::int64_t>, 3> color, depth;
  RayArray<std::uint32_t> unavailable;  ///< not 0: the ray needs a tile that is unavailable
};

/// Thread-safety: one thread.
class BlockTiles {
 public:
  /// A tile, as it was found.
  struct Found {
    std::int64_t color = 0, depth = 0;  ///< as in TileOffsets
    bool unavailable = false;
  };

  BlockTiles() = default;
  BlockTiles(const BlockTiles&) = delete;
  BlockTiles& operator=(const BlockTiles&) = delete;

  /// Begins a view of a state, which needs colours or, with depth, depths, too. Appends the keys of
  /// the tiles that it uses, with repetitions, to `touched`, which must outlive the view.
  void begin_view(unsigned state, bool with_depth, std::vector<TileKey>& touched);

  /// Begins a pass over a level. `frame` is the number that its tiles get. Geometry and table must
  /// outlive it. `wait`: the caller will load absent tiles and call find() again; otherwise they
  /// are unavailable.
  void begin_pass(std::uint32_t frame, const LevelGeometry& geometry, const PageTable& table,
                  bool wait);

  /// Finds a tile and stamps it as used by the frame. Not inlined: the kernel's loop, which calls
  /// it rarely, keeps its registers. REQUIRES: a ReadScope until the samples are gathered.
  [[gnu::noinline]] Found find(std::uint32_t entry, std::uint32_t exit);

  /// The stamp in TilePage::found of loaded tiles that the frame has found before.
  [[nodiscard]] std::uint64_t stamp() const { return stamp_; }
  [[nodiscard]] const PageTable& table() const { return *table_; }
  [[nodiscard]] bool with_depth() const { return with_depth_; }

  /// The tiles that were not loaded, with some repetitions.
  [[nodiscard]] const std::vector<TileKey>& absent() const { return absent_; }
  /// Whether any ray needs a tile that is unavailable.
  [[nodiscard]] bool any_unavailable() const { return any_unavailable_; }

 private:
  static constexpr std::uint32_t kRecent = 64;

  /// Marks a tile as used by the frame. False: it cannot be read, and was added to absent().
  [[nodiscard]] bool mark_used(std::uint32_t entry, std::uint32_t exit, TilePage* page,
                               bool loaded);

  unsigned state_ = 0;
  std::uint32_t frame_ = 0;
  std::uint64_t stamp_ = 0;
  bool with_depth_ = false, wait_ = false, any_unavailable_ = false;
  const LevelGeometry* geometry_ = nullptr;
  const PageTable* table_ = nullptr;
  std::vector<TileKey>* touched_ = nullptr;
  std::vector<TileKey> absent_;
  std::array<std::uint32_t, kRecent> recent_{};  // places in absent_, by hash
};

}  // namespace slf
