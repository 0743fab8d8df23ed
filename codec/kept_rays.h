// The rays that a tile has in common with the same tile of an earlier state. They are kept from
// that tile, and nothing else of them is coded (FORMAT.md, "States"). For encoder and decoder:
//
//   rays.begin(tile, predicted);    // whose `earlier` is that tile
//   rays.choose(...);               // encoder only
//   rays.code(coder);               // which rays are kept
//   ... code the other rays, predicted by rays.prediction() ...
//   rays.restore(depth, rgba);
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <vector>

#include "codec/codec.h"
#include "codec/prediction.h"
#include "codec/predictive.h"
#include "codec/predictive_tables.h"
#include "codec/range_coder.h"

namespace slf::codec {

/// Memory is kept from tile to tile. What begin() was given must outlive the use of a tile.
class KeptRays {
 public:
  /// REQUIRES: `predicted.earlier` has as many bytes as the tile, in rgba8_depth8.
  void begin(const TileShape& tile, const Predicted& predicted);

  /// Keeps the rays that differ from the samples by about as much as if they were coded.
  void choose(const PredictiveLevel& level, int scale, const TilePicture& picture,
              std::span<const std::uint8_t> depth, std::span<const std::uint32_t> rgba);

  /// Codes which rays are kept, row by row. `coder` is a RansEncoder or a RansDecoder.
  template <class Coder>
  void code(Coder& coder);

  /// For each pixel 255 if it holds a sample that is not kept, else 0.
  [[nodiscard]] std::span<const std::uint8_t> others(const TilePicture& picture);
  /// What predicts the tile, with the samples of kept rays.
  [[nodiscard]] Prediction prediction();
  /// Sets the samples of kept rays.
  void restore(std::span<std::uint8_t> depth, std::span<std::uint32_t> rgba) const;

 private:
  static constexpr std::size_t kLikely = 4;

  std::uint32_t side_ = 0;
  Prediction from_;
  std::vector<std::uint32_t> rgba_, color_;  // of the earlier tile; of the prediction
  std::vector<std::uint8_t> depth_, likely_, kept_, others_, alpha_, depths_;
};

/// A colour that is not multiplied by alpha, and 255 instead of alpha.
[[nodiscard]] std::uint32_t straight(std::uint32_t rgba);

/// How much a sample differs from what is predicted of it: FORMAT.md, "States".
[[nodiscard]] std::uint32_t difference(std::uint32_t rgba, std::uint8_t depth,
                                       std::uint8_t predicted_alpha, std::uint8_t predicted_depth,
                                       std::uint32_t color);

template <class Coder>
void KeptRays::code(Coder& coder) {
  /// By how well the prediction agrees with the ray, and how many of its neighbours are kept.
  static constexpr std::uint8_t kFirst[kLikely][4] = {
      {19, 99, 121, 224}, {57, 141, 181, 247}, {99, 174, 204, 251}, {114, 185, 215, 252}};
  std::array<std::array<BitModel, 8>, kLikely> models;
  for (std::size_t l = 0; l < kLikely; ++l)
    for (unsigned k = 0; k < 8; ++k)
      models[l][k] = BitModel(probability_of(kFirst[l][static_cast<unsigned>(std::popcount(k))]));
  for (std::size_t s = 0; s < kept_.size();)
    for (std::uint32_t q = 0; q <= side_; ++q)
      for (std::uint32_t p = 0; p + q <= side_; ++p, ++s) {
        const std::size_t line = side_ + 2 - q;  // to the sample above
        const unsigned w = p > 0 ? kept_[s - 1] : q > 0 ? kept_[s - line] : 1;
        const unsigned n = q > 0 ? kept_[s - line] : w;
        const unsigned ne = q > 0 ? kept_[s - line + 1] : n;
        BitModel& model = models[likely_[s]][w + 2 * n + 4 * ne];
        const bool kept = coder.bit(model, kept_[s] != 0);
        model.learn(kept);
        kept_[s] = kept ? 1 : 0;
      }
}

}  // namespace slf::codec
