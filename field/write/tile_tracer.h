// TileTracer: samples one tile's slabs from a scene, in the format of a manifest.
//
// At the finest level of a build, a slab is one ray. Coarser levels serve small and distant views,
// where single rays would alias. So there a slab is a mean of rays from its entry vertex to exit
// vertices of the next finer lattice, weighted by a tent filter as wide as the level's cells.
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "field/geometry/level_geometry.h"
#include "field/manifest.h"
#include "field/write/tile_source.h"
#include "slf/scene.h"

namespace slf {

/// The scenes, of one state each, must outlive the tracer. Thread-safety: const members from any
/// thread.
class TileTracer final : public TileSource {
 public:
  /// `place`: named by errors.
  TileTracer(std::span<const Scene* const> scenes, const Manifest& manifest,
             std::string place = "scene");
  TileTracer(const Scene& scene, const Manifest& manifest)
      : TileTracer(std::array{&scene}, manifest) {}

  /// Samples a tile. failed: the scene threw an exception. out_of_memory.
  [[nodiscard]] Result<void> tile(TileKey key, SourceTile& tile) const override;
  /// The rays of a tile, on average.
  [[nodiscard]] std::uint64_t work(unsigned level) const override;

  [[nodiscard]] TileShape shape(TileKey key) const;
  /// Approximate number of rays for a tile.
  [[nodiscard]] std::uint64_t rays(TileKey key) const;
  [[nodiscard]] const LevelGeometry& geometry(unsigned level) const { return levels_[level]; }

 private:
  void trace(TileKey key, SourceTile& tile) const;
  /// A filtered level traces the exit lattice of the next finer one, with four times the vertices.
  [[nodiscard]] std::uint64_t rays_per_slab(unsigned level) const {
    return filtered_[level] ? 4 : 1;
  }

  std::vector<const Scene*> scenes_;
  std::string place_;
  FieldShape shape_;
  std::vector<bool> filtered_;  // per level
  SampleFormat format_;
  std::vector<LevelGeometry> levels_;
};

}  // namespace slf
