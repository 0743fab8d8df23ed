// The arithmetic of the plane light field's rendering, compiled for several instruction sets.
//
// Works as field/render/ray_kernel.h and gather_kernel.h do for spheres: on structures of arrays,
// with as many rays at a time as there are lanes. Arrays are longer than the block by kPadding.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "benchmarks/plane/slabs.h"

namespace slf::bench {

inline constexpr std::size_t kPadding = 64;
inline constexpr int kRowShift = 3;  ///< 8 × 8 uv nodes are a tile's rows
inline constexpr int kRowEdge = 1 << kRowShift;
inline constexpr int kColumnShift = 3;  ///< 8 × 8 st cells, so 9 × 9 nodes, are its columns
inline constexpr int kColumnEdge = (1 << kColumnShift) + 1;
inline constexpr int kTileRows = kRowEdge * kRowEdge;
inline constexpr int kTileColumns = kColumnEdge * kColumnEdge;
inline constexpr int kTileSamples = kTileRows * kTileColumns;

/// How nodes are cut into tiles; counts are along an edge.
struct TileGrid {
  std::int32_t row_blocks = 1;
  std::int32_t column_blocks = 1;

  explicit TileGrid(const PlaneShape& shape)
      : row_blocks((shape.first_nodes + kRowEdge - 1) >> kRowShift),
        column_blocks((shape.second_nodes - 1 + kColumnEdge - 2) >> kColumnShift) {}
  [[nodiscard]] std::int32_t tiles() const {
    return 6 * row_blocks * row_blocks * column_blocks * column_blocks;
  }
};

/// The rays of a picture, in units where the sphere is the unit sphere around the origin.
struct PlaneBasis {
  glm::vec3 eye, corner, across, down;
  std::uint32_t width = 0;
};

/// The rays of a block of pixels that cross the sphere, and the samples that each reads: four
/// columns (st nodes) in each of four rows of tiles (uv nodes).
struct PlaneRays {
  std::size_t count = 0;
  std::vector<std::uint32_t> pixel;
  std::array<std::vector<std::uint32_t>, 4> tile;  ///< [corner of the uv cell]
  std::array<std::vector<std::uint32_t>, 4> row;   ///< its first sample in the tile
  std::vector<std::uint32_t> column;               ///< of the st cell's first corner
  std::array<std::vector<float>, 4> part;          ///< u, v, s, t within their cells

  void resize(std::size_t size);
};

/// Locates the samples of the rays of pixels [x0, x1) × [y0, y1).
void locate_samples(const PlaneShape& shape, const PlaneBasis& basis, std::uint32_t x0,
                    std::uint32_t x1, std::uint32_t y0, std::uint32_t y1, PlaneRays& rays);

/// Gathers the samples (rgba8) and interpolates them quadrilinearly. Tile t begins at sample
/// tiles[t] × kTileSamples. REQUIRES: fewer than 2^31 samples, and one more after the last.
void blend(const PlaneRays& rays, const std::uint32_t* tiles, const std::uint32_t* samples,
           glm::vec4* rgba);

}  // namespace slf::bench
