// TilePredictor: predicts the tiles of one level from decoded tiles of the next coarser level. All
// machines and instruction sets predict the same bytes.
//
// This is the arithmetic. TileCoder (field/tile_coder.h) calls it and tells the codec the result.
//
// Thread-safety: a TilePredictor is immutable.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "codec/prediction.h"
#include "field/predict/prediction_kernel.h"
#include "field/predict/references.h"

namespace slf {

/// A tile's predicted opacities, depths, and straight colours: R, G, B from the lowest byte on,
/// then 255.
struct PredictedSamples {
  std::vector<std::uint8_t> alpha, depth;
  std::vector<std::uint32_t> color;

  [[nodiscard]] codec::Prediction view() const { return {alpha, depth, color}; }
};

/// The scale of a tile's quantisation steps (codec::Predicted). Lattices are denser near the axes;
/// there, more rays share the same lines, so each may be coarser or finer: the steps of tiles go
/// with the root of the area for each ray.
[[nodiscard]] int step_scale(const TileSections& sections);

/// Rays are looked up to every other column, at depths that are found at every eighth; between
/// these, they are interpolated (FORMAT.md, "Prediction").
class TilePredictor {
 public:
  /// A predictor for the tile with these sections. `references` are those of its entry section.
  /// `coarser` and `references` must outlive the predictor. REQUIRES: finer.level() ==
  /// coarser.level() + 1.
  TilePredictor(const LevelGeometry& coarser, const LevelGeometry& finer,
                const TileSections& sections, const References& references);

  /// How often predicting a tile with these samples would read each candidate.
  [[nodiscard]] std::vector<std::uint32_t> uses(std::span<const std::uint8_t> alpha,
                                                std::span<const std::uint8_t> depth) const;

  /// `from` are the candidates' samples, in the order of Candidates. `four_taps`: of colours
  /// between columns that are looked up (Codec::four_taps()).
  void predict(std::span<const ReferenceTile> from, bool four_taps,
               PredictedSamples& predicted) const;

 private:
  [[nodiscard]] PredictedRow row(std::size_t index, std::span<const ReferenceTile> from) const;

  const LevelGeometry& coarser_;
  const References& references_;
  std::uint32_t side_;
  std::size_t columns_;
  unsigned stride_;  // between the columns that are looked up, along p and q
  unsigned sparse_;  // between those at which depth is found: a power of two, times stride_
  Points points_, sparse_points_;
};

}  // namespace slf
