// TilePredictor: predicts the tiles of one level from the decoded tiles of the level above it.
//
// In two steps, since a colour's prediction takes the tile's own depth:
//   predictor.alpha_depth(from, alpha, depth);     // to decode alpha and depth with
//   predictor.color(from, alpha, depth, color);    // to decode colour with
// Everything is exact: all machines and instruction sets predict the same bytes.
//
// Thread-safety: a TilePredictor is immutable.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "field/predict/prediction_kernel.h"
#include "field/predict/references.h"

namespace slf {

class TilePredictor {
 public:
  /// Of the tiles with these sections, whose references are given. Borrows the coarser geometry,
  /// which is that of the level before finer's.
  TilePredictor(const LevelGeometry& coarser, const LevelGeometry& finer,
                const TileSections& sections, References references);

  /// How many look-ups would go to each candidate if these were a tile's samples.
  [[nodiscard]] std::vector<std::uint32_t> uses(std::span<const std::uint8_t> alpha,
                                                std::span<const std::uint8_t> depth) const;

  /// Predicts a tile's opacities and depths. `from` are the candidates' samples, in the order of
  /// candidates_of.
  void alpha_depth(std::span<const ReferenceTile> from, std::span<std::uint8_t> alpha,
                   std::span<std::uint8_t> depth) const;

  /// Predicts its colours, not multiplied by alpha: R, G, B from the lowest byte on. Samples of
  /// zero alpha become 0.
  void color(std::span<const ReferenceTile> from, std::span<const std::uint8_t> alpha,
             std::span<const std::uint8_t> depth, std::span<std::uint32_t> color) const;

 private:
  [[nodiscard]] PredictedRow row(std::size_t index, std::span<const ReferenceTile> from) const;

  const LevelGeometry& coarser_;
  References references_;
  std::uint32_t side_;
  std::size_t columns_;
  Points points_;       // of all columns
  Points even_points_;  // of the columns with even p and q
  std::vector<std::uint32_t> even_columns_;
};

}  // namespace slf
