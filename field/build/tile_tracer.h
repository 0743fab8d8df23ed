// TileTracer: samples one tile's slabs from a scene, in the formats of a manifest's layers.
//
// At the finest level of a build a slab is one ray. At the others, which serve small and distant
// views, it is the mean of the rays to the exit vertices of the next finer level around its own,
// weighted by a tent as wide as its cells: what such a view shows of it, without aliasing.
#pragma once

#include <memory>
#include <vector>

#include "field/geometry/level_geometry.h"
#include "field/manifest.h"
#include "slf/scene.h"

namespace slf {

/// A tile's samples before encoding; reused from tile to tile.
struct TracedTile {
  TileKey key;
  bool empty = true;          ///< nothing visible anywhere; `layers` is then meaningless
  std::vector<Bytes> layers;  ///< in the manifest's order, each laid out as codec::Tile says
};

/// Thread-safety: const members from many threads. Borrows the scene.
class TileTracer {
 public:
  TileTracer(const Scene& scene, const Manifest& manifest);

  /// failed: the scene threw an exception, or there is not enough memory; names the tile.
  [[nodiscard]] Result<void> trace(TileKey key, TracedTile& tile) const;

  [[nodiscard]] codec::Tile shape(TileKey key, codec::SampleFormat format) const;
  /// Rays that a tile, or all tiles of a level, take, about.
  [[nodiscard]] std::uint64_t rays(TileKey key) const;
  [[nodiscard]] std::uint64_t rays(unsigned level) const;
  [[nodiscard]] const LevelGeometry& geometry(unsigned level) const { return levels_[level]; }

 private:
  void trace_rays(TileKey key, TracedTile& tile) const;
  /// A tent's cells are half as wide as the level's own.
  [[nodiscard]] std::uint64_t rays_per_slab(unsigned level) const {
    return filtered_[level] ? 4 : 1;
  }

  const Scene& scene_;
  FieldShape shape_;
  std::vector<bool> filtered_;  // per level
  std::vector<codec::SampleFormat> formats_;
  std::vector<LevelGeometry> levels_;
};

}  // namespace slf
