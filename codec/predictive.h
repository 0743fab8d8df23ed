// The predictive codec: codes opacity, depth and colour of a tile as differences from a prediction
// that the caller makes (FORMAT.md, "The predictive codec").
//
// It works in stages, because the prediction of colour needs the tile's own decoded depth:
//
//   PredictiveDecoder decoder(level, picture, payload);
//   decoder.references(kinds, used);       // which of the caller's candidates to predict from
//   ... predict alpha and depth ...
//   decoder.alpha_depth(alpha, depth);     // from predictions to samples, in place
//   ... predict colours, not multiplied by alpha ...
//   decoder.color(alpha, predicted, rgba);
//   decoder.finish();
//
// The codec does not depend on spheres: the caller makes the predictions (field/predict). Payloads
// are untrusted. Decoding uses integers only, so samples are the same on every machine.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "codec/alpha_levels.h"
#include "codec/block_coder.h"
#include "codec/codec.h"
#include "codec/predictive_tables.h"
#include "codec/range_coder.h"
#include "slf/error.h"

namespace slf::codec {

/// The arrangement of a tile's samples in one picture, which is divided into 8 × 8 blocks. It
/// depends on the tile's rows and side only.
class TilePicture {
 public:
  explicit TilePicture(const Tile& tile);

  [[nodiscard]] std::size_t width() const { return width_; }    ///< a multiple of 8
  [[nodiscard]] std::size_t height() const { return height_; }  ///< the same
  [[nodiscard]] std::size_t pixels() const { return width_ * height_; }
  [[nodiscard]] std::size_t samples() const { return pixel_of_.size(); }
  /// For each sample, the index of its pixel.
  [[nodiscard]] std::span<const std::uint32_t> pixel_of() const { return pixel_of_; }
  /// For each pixel, 1 if it holds a sample, else 0.
  [[nodiscard]] std::span<const std::uint8_t> covered() const { return covered_; }

 private:
  std::size_t width_, height_;
  std::vector<std::uint32_t> pixel_of_;
  std::vector<std::uint8_t> covered_;
};

/// The common part of encoder and decoder: the state of a tile between the stages. Keeps references
/// to its arguments, which must outlive it.
template <class Coder>
class PredictiveTile {
 public:
  PredictiveTile(const PredictiveTile&) = delete;  // BitCounts are those of its own models
  PredictiveTile& operator=(const PredictiveTile&) = delete;

 protected:
  template <class Bytes>
  PredictiveTile(const PredictiveLevel& level, const TilePicture& picture, Bytes& payload);

  /// Codes those of `blocks` that are `coded`. Returns each sample's difference from the
  /// prediction, as the decoder will restore it.
  [[nodiscard]] std::vector<std::int16_t> code_plane(std::size_t plane,
                                                     std::span<const std::uint8_t> coded,
                                                     BlockPlane& blocks);
  /// These turn predictions into samples. Alpha is coded by `blocks` if `soft`, else by `levels`.
  void code_alpha(bool soft, std::span<std::uint8_t> levels, BlockPlane& blocks,
                  std::span<std::uint8_t> alpha);
  void code_depth(BlockPlane& blocks, std::span<const std::uint8_t> alpha,
                  std::span<std::uint8_t> depth);
  void code_color(std::array<BlockPlane, 3>& blocks, std::span<const std::uint8_t> alpha,
                  std::span<const std::uint32_t> predicted, std::span<std::uint32_t> rgba);
  [[nodiscard]] BlockPlane empty_plane() const;
  [[nodiscard]] std::vector<std::uint8_t> visible_blocks(
      std::span<const std::uint8_t> pixels) const;

  const PredictiveLevel& level_;
  const TilePicture& picture_;
  PredictiveModels models_;
  Coder coder_;
  std::vector<std::uint8_t> visible_;  // the tile's visible_blocks(), once alpha is coded
};

class PredictiveEncoder : PredictiveTile<RangeEncoder> {
 public:
  /// Appends to `payload`.
  PredictiveEncoder(const PredictiveLevel& level, const TilePicture& picture, Bytes& payload);

  /// Counts decisions for training: `counts` has an entry for each model in PredictiveModels.
  void count(BitCounts* counts);

  /// Codes which candidates are used. `kinds`, in [0, kReferenceKinds), selects a model: candidates
  /// of one kind are used about equally often.
  void references(std::span<const std::uint8_t> kinds, std::span<const std::uint8_t> used);
  /// `alpha` and `depth` are predictions; they are replaced by the values that the decoder will
  /// have.
  void alpha_depth(std::span<const std::uint8_t> true_alpha,
                   std::span<const std::uint8_t> true_depth, std::span<std::uint8_t> alpha,
                   std::span<std::uint8_t> depth);
  /// `alpha` is the decoder's. `rgba`, premultiplied with R in the lowest byte, is replaced by the
  /// colours that the decoder will have.
  void color(std::span<const std::uint8_t> alpha, std::span<const std::uint32_t> predicted,
             std::span<std::uint32_t> rgba);
  void finish();

 private:
  [[nodiscard]] BlockPlane quantise(std::size_t plane, std::span<const std::uint8_t> coded,
                                    std::span<const float> weight, std::vector<float>& difference,
                                    float round_up_from);
  [[nodiscard]] double alpha_cost(bool soft, std::vector<std::uint8_t> levels, BlockPlane blocks,
                                  std::span<const std::uint8_t> true_alpha,
                                  std::span<const std::uint8_t> predicted) const;
};

class PredictiveDecoder : PredictiveTile<RangeDecoder> {
 public:
  PredictiveDecoder(const PredictiveLevel& level, const TilePicture& picture, ByteSpan payload);

  void references(std::span<const std::uint8_t> kinds, std::span<std::uint8_t> used);
  void alpha_depth(std::span<std::uint8_t> alpha, std::span<std::uint8_t> depth);
  void color(std::span<const std::uint8_t> alpha, std::span<const std::uint32_t> predicted,
             std::span<std::uint32_t> rgba);
  /// bad_file: the payload is longer or shorter than the coded data.
  [[nodiscard]] Result<void> finish() const;
};

}  // namespace slf::codec
