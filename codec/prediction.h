// Predictor: what a codec that predicts tiles asks about a tile. Codecs know of no spheres, so the
// field that has the tile answers: TileCoder implements it (field/tile_coder.cc) on top of
// TilePredictor (field/predict), which does the arithmetic.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "slf/error.h"

namespace slf::codec {

/// What is predicted of each sample of a tile.
struct Prediction {
  std::span<const std::uint8_t> alpha, depth;
  std::span<const std::uint32_t> color;  ///< not multiplied by alpha; R in the lowest byte
};

/// Candidates differ in how often they are used.
inline constexpr std::size_t kReferenceKinds = 4;

/// Predicts one tile of a level above 0 from others, its candidates. For one thread. choose() and
/// predict() may decode candidates with the same codec on this thread. So a codec must not have
/// thread-local scratch in use while it calls them.
class Predictor {
 public:
  virtual ~Predictor() = default;

  [[nodiscard]] virtual unsigned level() const = 0;

  /// The kind of each candidate, below kReferenceKinds.
  [[nodiscard]] virtual std::span<const std::uint8_t> kinds() const = 0;

  /// For each candidate 1 if a tile with these opacities and depths should be predicted from it,
  /// else 0.
  [[nodiscard]] virtual Result<std::vector<std::uint8_t>> choose(
      std::span<const std::uint8_t> alpha, std::span<const std::uint8_t> depth) = 0;

  /// Predicts from the candidates whose entry in `used`, which may be untrusted, is not 0. The
  /// prediction is valid until this thread predicts again.
  [[nodiscard]] virtual Result<Prediction> predict(std::span<const std::uint8_t> used) = 0;
};

}  // namespace slf::codec
