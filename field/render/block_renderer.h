// BlockRenderer: draws the rays of a block of pixels. Private to field/render.
//
// A block passes through the stages
//   cast (ray_kernel.h) -> locate (ray_kernel.h) -> gather (sample_gatherer.h)
//        -> blend (blend_kernel.h) -> refine (depth_refinement.h) -> bend (blend_kernel.h)
// With planes, samples beyond them are made empty between gather and blend (cut.h). Rays whose
// samples cannot tell what the planes lay open are traced through a scene in the end.
// Modes differ in the weights that locate computes. Only mode depth refines: it locates, gathers
// and blends again, and in the end interpolates cubically where samples differ. Rays that need an
// unavailable tile pass through the stages of the next coarser level.
#pragma once

#include <atomic>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "field/render/cut.h"
#include "field/render/depth_refinement.h"
#include "field/render/ray_block.h"
#include "field/render/ray_kernel.h"
#include "field/render/sample_gatherer.h"
#include "slf/render.h"

namespace slf {

/// Counts of the pixels that a thread draws.
struct PixelCounts {
  std::uint64_t hit = 0;             ///< pixels whose ray crosses the sphere
  std::vector<std::uint64_t> level;  ///< of `hit`, the pixels drawn from each level
};

/// Reused from block to block and from view to view. Thread-safety: one thread.
class BlockRenderer {
 public:
  /// Field and cache must outlive this. `pin_bytes` is passed to the SampleGatherer.
  BlockRenderer(const FieldFile& field, TileCache& cache, std::uint64_t pin_bytes);

  /// Begins a view. Its blocks are drawn into `image`, which must stay alive; depths are distances
  /// from `eye`, in world units. `frame` as for SampleGatherer::begin().
  void begin(std::atomic<std::uint32_t>& frame, const ViewOptions& options, const glm::dvec3& eye,
             Image& image);

  /// Draws a block of at most kBlockRays pixels.
  [[nodiscard]] Result<void> draw(const CameraBasis& basis, const PixelBlock& block);

  [[nodiscard]] const PixelCounts& counts() const { return counts_; }
  [[nodiscard]] const SampleGatherer& gatherer() const { return gatherer_; }

 private:
  [[nodiscard]] Result<void> draw_level(const LevelGeometry& geometry);
  [[nodiscard]] Result<void> gather_and_blend(const LevelGeometry& geometry, const Pass& pass);
  void prefetch(const PixelBlock& block);
  void clear(const PixelBlock& block);
  void set_empty(std::uint32_t pixel);
  void write_distances();
  /// Leaves to the field the rays that begin in what planes leave.
  void separate_cut_rays();
  void trace_cut_rays();

  const FieldFile& field_;
  SampleGatherer gatherer_;
  ViewOptions options_;
  glm::dvec3 eye_{0.0};
  Image* image_ = nullptr;
  RayBlock rays_, unavailable_;  // the level's rays; those left to the next coarser level
  KeptSpace kept_;
  RayBlock cut_;                    // rays through ViewOptions::cap
  RayArray<std::uint32_t> became_;  // CutRay of the level's rays
  EntryCells entries_;
  ExitCells exits_;
  DepthRefinement refinement_;
  PixelCounts counts_;
};

}  // namespace slf
