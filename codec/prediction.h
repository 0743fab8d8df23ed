// What a codec that predicts tiles is told about a tile of a level above 0. Codecs know of no
// spheres: TileCoder (field/tile_coder.h) finds the tiles that this one may be predicted from, and
// predicts.
#pragma once

#include <cstdint>
#include <span>

#include "base/bytes.h"

namespace slf::codec {

/// What is predicted of each sample of a tile.
struct Prediction {
  std::span<const std::uint8_t> alpha, depth;
  std::span<const std::uint32_t> color;  ///< not multiplied by alpha; R in the lowest byte
};

/// What is predicted by nothing: matter that is transparent, grey, and in the middle of the chord.
inline constexpr std::uint8_t kUnpredictedAlpha = 0, kUnpredictedDepth = 128;
inline constexpr std::uint32_t kUnpredictedColor = 0xFF808080;

/// Candidates differ in how often they are used.
inline constexpr std::size_t kReferenceKinds = 4;

/// The scale that leaves quantisation steps as they are.
inline constexpr int kPlainScale = 16;

/// A prediction of a tile from some of the tiles that it may be predicted from, its candidates.
struct Predicted {
  unsigned level = 0;                   ///< of the tile
  std::span<const std::uint8_t> kinds;  ///< of each candidate, below kReferenceKinds
  std::span<const std::uint8_t>
      used;  ///< for each candidate 1 if it is predicted from that, else 0
  Prediction prediction;
  int scale = kPlainScale;  ///< of quantisation steps, 1..255
  ByteSpan earlier = {};    ///< the same tile of an earlier state, whose rays may be kept, or none
};

}  // namespace slf::codec
