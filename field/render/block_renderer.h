// BlockRenderer: gives the rays of a block of pixels their colours. Private to field/.
//
// All modes are passes of the same three steps: each ray's entry vertices are aimed at an exit
// point, the samples are gathered, the values blended. The first pass aims where the ray itself
// leaves; mode depth aims anew at what the pass before saw, until that is where it aimed.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <vector>

#include "field/render/ray_block.h"
#include "field/render/taps.h"
#include "slf/render.h"

namespace slf {

/// Reused from block to block. Thread-safety: one thread.
class BlockRenderer {
 public:
  /// By level.
  using Kept = std::vector<KeptTiles>;

  /// Borrows all; where it waits for tiles, pins at most `pin_bytes` of them. Pixels are written
  /// into `image`, whose depths are distances from `eye`, in world units. `earlier` is what the
  /// picture before kept.
  BlockRenderer(const FieldFile& field, TileCache& cache, std::uint64_t pin_bytes,
                const ViewOptions& options, const glm::dvec3& eye, Image& image, Kept earlier = {});

  /// The block to draw: fill it, then draw(). Sized for `most_rays`.
  [[nodiscard]] RayBlock& rays(std::size_t most_rays);

  /// Draws the block's pixels, and takes its rays. Pixels that need a missing tile are drawn from
  /// the next coarser level; each counts in `level_pixels` for the level that had all it needs.
  [[nodiscard]] Result<void> draw(std::vector<std::uint64_t>& level_pixels);

  /// Appends the tiles touched since this was made, and of them those that were not waited for;
  /// with repetitions.
  void add_tiles_to(std::vector<TileKey>& touched, std::vector<TileKey>& wanted);

  /// The end: the tiles that were not waited for, still pinned.
  [[nodiscard]] Kept keep() &&;

 private:
  [[nodiscard]] bool waits(unsigned level) const { return options_.wait || level == 0; }
  [[nodiscard]] TapGatherer& gatherer(unsigned level);
  [[nodiscard]] Result<void> draw_level(const LevelGeometry& geometry);
  void aim_where_rays_leave(const LevelGeometry& geometry, Pass& pass);
  void aim_at_what_was_seen(const LevelGeometry& geometry, Pass& pass);
  void keep_moving(const LevelGeometry& geometry);
  [[nodiscard]] Result<void> look(const LevelGeometry& geometry, const Pass& pass);
  void finish();

  const FieldFile& field_;
  const ViewOptions& options_;
  const glm::dvec3 eye_;
  Image& image_;
  TileCache& cache_;
  const std::uint64_t pin_bytes_;
  Kept earlier_;
  std::vector<std::optional<TapGatherer>> gatherers_;  // by level, so that each keeps its tiles
  TapGatherer* gatherer_ = nullptr;                    // of the level that is drawn
  std::size_t most_rays_ = 0;
  RayBlock rays_, missing_;
  EntryArrays entries_;
  std::array<PointArrays, 3> aims_;
  std::array<ExitArrays, 3> exits_;
  RayArray<float> t_;
};

}  // namespace slf
