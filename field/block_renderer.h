// BlockRenderer: gives the rays of a block of pixels their colours. Private to field/.
//
// All modes are passes of the same three steps: each ray's entry vertices are aimed at an exit
// point, the samples are gathered, the values blended. The first pass aims where the ray itself
// leaves; mode depth aims anew, twice, at what the pass before saw.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "field/ray_block.h"
#include "field/render.h"
#include "field/taps.h"

namespace slf {

/// Reused from block to block. Thread-safety: one thread.
class BlockRenderer {
 public:
  /// Borrows all; pins at most `pin_bytes` of the cache's tiles. Pixels are written into `image`,
  /// whose depths are distances from `eye`, in world units.
  BlockRenderer(const Field& field, TileCache& cache, std::uint64_t pin_bytes,
                const ViewOptions& options, const glm::dvec3& eye, Image& image);

  /// The block to draw: fill it, then draw(). Sized for `most_rays`.
  [[nodiscard]] RayBlock& rays(std::size_t most_rays);

  /// Draws the block's pixels, and takes its rays. Pixels that need a missing tile are drawn from
  /// the next coarser level; each counts in `level_pixels` for the level that had all it needs.
  [[nodiscard]] Result<void> draw(std::vector<std::uint64_t>& level_pixels);

  /// Tiles touched since this was last cleared; with repetitions.
  [[nodiscard]] std::vector<TileKey>& touched() { return gatherer_.touched(); }
  /// Of them, those that were not waited for.
  [[nodiscard]] std::vector<TileKey>& wanted() { return gatherer_.wanted(); }

 private:
  [[nodiscard]] Result<void> draw_level(const LevelGeometry& geometry);
  [[nodiscard]] Result<void> first_pass(const LevelGeometry& geometry, Pass& pass);
  [[nodiscard]] Result<void> depth_pass(const LevelGeometry& geometry,
                                        const std::array<const float*, 3>& t, Pass& pass);
  void keep_followed(const LevelGeometry& geometry);
  void finish_all();
  void finish(std::size_t ray);

  const Field& field_;
  const ViewOptions& options_;
  const glm::dvec3 eye_;
  Image& image_;
  TapGatherer gatherer_;
  RayBlock rays_, missing_;
  EntryArrays entries_;
  std::array<PointArrays, 3> aims_;
  std::array<ExitArrays, 3> exits_;
  RayArray<glm::vec4> rgba_;
  RayArray<float> t_;
};

}  // namespace slf
