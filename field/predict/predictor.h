// TilePredictor: predicts the tiles of one level from decoded tiles of the next coarser level.
//
// It works in two steps, because the prediction of colour needs the tile's own decoded depth:
//   predictor.alpha_depth(from, alpha, depth);     // then decode alpha and depth
//   predictor.color(from, alpha, depth, color);    // then decode colour
// All machines and instruction sets predict the same bytes.
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
  /// A predictor for the tile with these sections. `references` are those of its entry section.
  /// `coarser` must outlive the predictor. REQUIRES: finer.level() == coarser.level() + 1.
  TilePredictor(const LevelGeometry& coarser, const LevelGeometry& finer,
                const TileSections& sections, References references);

  /// How often predicting a tile with these samples would read each candidate.
  [[nodiscard]] std::vector<std::uint32_t> uses(std::span<const std::uint8_t> alpha,
                                                std::span<const std::uint8_t> depth) const;

  /// Predicts a tile's opacities and depths. `from` are the candidates' samples, in the order of
  /// candidates_of.
  void alpha_depth(std::span<const ReferenceTile> from, std::span<std::uint8_t> alpha,
                   std::span<std::uint8_t> depth) const;

  /// Predicts a tile's straight colours: R, G, B from the lowest byte on. Samples of zero alpha
  /// become 0.
  void color(std::span<const ReferenceTile> from, std::span<const std::uint8_t> alpha,
             std::span<const std::uint8_t> depth, std::span<std::uint32_t> color) const;

 private:
  [[nodiscard]] PredictedRow row(std::size_t index, std::span<const ReferenceTile> from) const;

  const LevelGeometry& coarser_;
  References references_;
  std::uint32_t side_;
  std::size_t columns_;
  Points points_;       // of all columns
  Points even_points_;  // of the columns with even p and q, or of all if the side is odd
};

}  // namespace slf
