// The arithmetic of predicting a tile from the next coarser level (FORMAT.md, "Prediction"),
// compiled for several instruction sets. Internal.
//
// Encoder and decoder must predict the same bytes on every machine. So weights are computed in IEEE
// binary32 with one rounding per operation, in a fixed order and without fused multiply-add, and
// then rounded to integers. Sums of integers stay below 2^24, so they are exact in any order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "field/geometry/level_geometry.h"

namespace slf {

/// Kernels work in whole vectors: they read and write up to this much beyond the last point.
inline constexpr std::size_t kPadding = 64;

/// Points on the unit sphere, as a structure of arrays. kPadding valid points follow the last.
struct Points {
  std::vector<float> x, y, z;
};

/// The decoded samples of a tile of the coarser level; null if the tile is empty or not used. The 8
/// bytes before each array are readable.
struct ReferenceTile {
  const std::byte* color = nullptr;  ///< rgba8
  const std::byte* depth = nullptr;
};

/// A vertex of the coarser entry lattice that a row is predicted from.
struct ReferenceVertex {
  float x = 0, y = 0, z = 0;             ///< its unit direction
  std::uint32_t row_begin = 0;           ///< the first sample of its row in a tile
  const ReferenceTile* tiles = nullptr;  ///< [exit section of the coarser level]
  std::uint32_t* uses = nullptr;         ///< [exit section]: look-ups, for count_uses()
};

/// One row of a tile: the rays from a vertex of the finer entry lattice.
struct PredictedRow {
  float x = 0, y = 0, z = 0;     ///< the vertex's unit direction
  std::uint32_t references = 1;  ///< 1: the same vertex, of the coarser lattice; 2: its neighbours
  ReferenceVertex reference[2];
};

/// Finds where the rays of `row` to `count` points meet something: their opacity and depth, a byte
/// each. Writes up to the next whole vector: `alpha` and `depth` have room for `count` + kPadding
/// bytes. REQUIRES: two references.
void find_depth(const LevelGeometry& coarser, const PredictedRow& row, const Points& points,
                std::size_t count, std::uint8_t* alpha, std::uint8_t* depth);

/// Predicts rays of `row` from what the references show at about these depths, which become the
/// predicted ones. Colours are straight, R, G and B from the lowest byte on, then 255; where
/// nothing is visible in the references they are 0. Arrays are read and written up to kPadding
/// beyond `count`.
void predict_samples(const LevelGeometry& coarser, const PredictedRow& row, const Points& points,
                     std::size_t count, std::uint8_t* alpha, std::uint8_t* depth,
                     std::uint32_t* color);

/// Counts the look-ups that rays of these depths need, except where `alpha` is 0.
void count_uses(const LevelGeometry& coarser, const PredictedRow& row, const Points& points,
                std::size_t count, const std::uint8_t* alpha, const std::uint8_t* depth);

}  // namespace slf
