// What a tile looks like from the level above: the arithmetic of FORMAT.md, "Prediction", compiled
// for several instruction sets. Private to field/.
//
// Encoder and decoder must predict the same bytes on every machine. So this is IEEE binary32 with
// one rounding per operation in a fixed order, never a fused multiply-add, up to where weights
// become integers; sums of integers are below 2^24 and exact in any order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "field/geometry/level_geometry.h"

namespace slf {

/// Kernels work in whole vectors: they read and write up to this much beyond the last point.
inline constexpr std::size_t kPadding = 64;

/// Points of the unit sphere, a structure of arrays; kPadding valid points follow the last.
struct Points {
  std::vector<float> x, y, z;
};

/// The decoded samples of a tile of the coarser level; null where nothing is visible or the tile
/// is not used. The 8 bytes before either are readable.
struct ReferenceTile {
  const std::byte* color = nullptr;  ///< rgba8
  const std::byte* depth = nullptr;
};

/// A vertex of the coarser entry lattice that a row is predicted from.
struct ReferenceVertex {
  float x = 0, y = 0, z = 0;             ///< its unit direction
  std::uint32_t row = 0;                 ///< its first sample in its section's tiles
  const ReferenceTile* tiles = nullptr;  ///< [exit section of the coarser level]
  std::uint32_t* uses = nullptr;  ///< if any, [exit section]: look-ups are added, stored or not
};

/// One row of a tile: the rays from a vertex of the finer entry lattice.
struct PredictedRow {
  float x = 0, y = 0, z = 0;     ///< the vertex's unit direction
  std::uint32_t references = 1;  ///< 1: the same vertex, of the coarser lattice; 2: its neighbours
  ReferenceVertex reference[2];
};

/// Predicts the opacity and depth, a byte each, of the rays of `row` to `count` points.
/// `alpha` and `depth` are written up to the next whole vector: kPadding more than `count`.
void predict_alpha_depth(const LevelGeometry& coarser, const PredictedRow& row,
                         const Points& points, std::size_t count, std::uint8_t* alpha,
                         std::uint8_t* depth);

/// Predicts the colour, not multiplied by opacity, of rays whose depths are known: R, G and B from
/// the lowest byte on, then 255, or 0 where the references see nothing. Rays of zero `alpha` are
/// left out: all 0. The arrays are read and written up to kPadding beyond `count`.
void predict_color(const LevelGeometry& coarser, const PredictedRow& row, const Points& points,
                   std::size_t count, const std::uint8_t* alpha, const std::uint8_t* depth,
                   std::uint32_t* color);

}  // namespace slf
