// TileTracer: samples one tile's slabs from a scene, in the format of a manifest.
//
// At the finest level of a build, a slab is one ray. Coarser levels serve small and distant views,
// where single rays would alias. So there a slab is a mean of rays from its entry vertex to exit
// vertices of the next finer lattice, weighted by a tent filter as wide as the level's cells.
#pragma once

#include <array>
#include <functional>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "field/geometry/level_geometry.h"
#include "field/manifest.h"
#include "slf/scene.h"

namespace slf {

/// A tile's samples before encoding; reused from tile to tile.
struct TracedTile {
  TileKey key;
  bool empty = true;  ///< nothing is visible; `samples` is then undefined
  Bytes samples;      ///< with the layout of TileShape
};

/// The scenes, of one state each, must outlive the tracer. Thread-safety: const members from any
/// thread.
class TileTracer {
 public:
  TileTracer(std::span<const Scene* const> scenes, const Manifest& manifest);
  TileTracer(const Scene& scene, const Manifest& manifest)
      : TileTracer(std::array{&scene}, manifest) {}
  /// Does not trace, but reads tiles with `read`.
  using Read = std::function<Result<void>(TileKey, TracedTile&)>;
  TileTracer(Read read, const Manifest& manifest)
      : TileTracer(std::span<const Scene* const>(), manifest) {
    read_ = std::move(read);
  }

  /// Samples a tile. failed: the scene threw an exception. out_of_memory. Messages name the tile.
  [[nodiscard]] Result<void> trace(TileKey key, TracedTile& tile) const;

  [[nodiscard]] TileShape shape(TileKey key) const;
  /// Approximate number of rays for a tile, or for all tiles of a level, of one state.
  [[nodiscard]] std::uint64_t rays(TileKey key) const;
  [[nodiscard]] std::uint64_t rays(unsigned level) const;
  [[nodiscard]] const LevelGeometry& geometry(unsigned level) const { return levels_[level]; }

 private:
  void trace_rays(TileKey key, TracedTile& tile) const;
  /// A filtered level traces the exit lattice of the next finer one, with four times the vertices.
  [[nodiscard]] std::uint64_t rays_per_slab(unsigned level) const {
    return filtered_[level] ? 4 : 1;
  }

  std::vector<const Scene*> scenes_;
  Read read_;
  FieldShape shape_;
  std::vector<bool> filtered_;  // per level
  SampleFormat format_;
  std::vector<LevelGeometry> levels_;
};

}  // namespace slf
