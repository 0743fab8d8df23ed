// The predictive codec: a tile's opacity, depth and colour together, coded as what differs from a
// prediction that the caller makes (FORMAT.md, "The predictive codec").
//
// In stages, as the prediction of colour takes the tile's own decoded depth:
//
//   PredictiveDecoder decoder(level, picture, payload);
//   decoder.references(kinds, used);       // which of the caller's candidates it predicts from
//   ... predict alpha and depth ...
//   decoder.alpha_depth(alpha, depth);     // from predictions to samples, in place
//   ... predict colours, not multiplied by alpha ...
//   decoder.color(alpha, predicted, rgba);
//   decoder.finish();
//
// It knows no spheres: what predictions are made of is the caller's business. Payloads are
// untrusted, and samples follow from them in integers alone, the same on every machine.
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

/// How a tile's samples lie in the picture that blocks divide. A function of its rows and side.
class TilePicture {
 public:
  explicit TilePicture(const Tile& tile);

  [[nodiscard]] std::size_t width() const { return width_; }    ///< a multiple of 8
  [[nodiscard]] std::size_t height() const { return height_; }  ///< the same
  [[nodiscard]] std::size_t pixels() const { return width_ * height_; }
  [[nodiscard]] std::size_t samples() const { return pixel_of_.size(); }
  /// Per sample, its pixel, and the block that has it.
  [[nodiscard]] std::span<const std::uint32_t> pixel_of() const { return pixel_of_; }
  [[nodiscard]] std::span<const std::uint32_t> block_of() const { return block_of_; }
  /// Per pixel, 1 where it shows a sample.
  [[nodiscard]] std::span<const std::uint8_t> shows() const { return shows_; }

 private:
  std::size_t width_, height_;
  std::vector<std::uint32_t> pixel_of_, block_of_;
  std::vector<std::uint8_t> shows_;
};

/// What encoder and decoder have in common: the state of a tile between the stages. Borrows all
/// that it is given.
template <class Coder>
class PredictiveTile {
 protected:
  template <class Bytes>
  PredictiveTile(const PredictiveLevel& level, const TilePicture& picture, Bytes& payload);

  /// Codes `blocks` where a sample is to be seen, and leaves what they add to predictions in
  /// added(plane).
  void code_plane(std::size_t plane, std::span<const std::uint8_t> wanted, BlockPlane& blocks);
  /// From predictions to samples; `levels` or `blocks` are coded, whichever `soft` says.
  void code_alpha(bool soft, std::span<std::uint8_t> levels, BlockPlane& blocks,
                  std::span<std::uint8_t> alpha);
  void code_depth(BlockPlane& blocks, std::span<const std::uint8_t> alpha,
                  std::span<std::uint8_t> depth);
  void code_color(std::array<BlockPlane, 3>& blocks, std::span<const std::uint8_t> alpha,
                  std::span<const std::uint32_t> predicted, std::span<std::uint32_t> rgba);
  [[nodiscard]] BlockPlane no_blocks() const;
  [[nodiscard]] std::vector<std::uint8_t> wanted(std::span<const std::uint8_t> alpha) const;

  const PredictiveLevel& level_;
  const TilePicture& picture_;
  PredictiveModels models_;
  Coder coder_;
  std::array<std::vector<std::int16_t>, 3> added_;  // per pixel; scratch
};

class PredictiveEncoder : PredictiveTile<RangeEncoder> {
 public:
  /// Appends to `payload`.
  PredictiveEncoder(const PredictiveLevel& level, const TilePicture& picture, Bytes& payload);

  /// Counts decisions for training: `counts` has one for each model of a PredictiveModels.
  void count(BitCounts* counts);

  /// Which candidates are used; `kinds` [0, kReferenceKinds) tells apart those that are used more
  /// or less often.
  void references(std::span<const std::uint8_t> kinds, std::span<const std::uint8_t> used);
  /// `alpha` and `depth` are predictions and become what the decoder will have.
  void alpha_depth(std::span<const std::uint8_t> true_alpha,
                   std::span<const std::uint8_t> true_depth, std::span<std::uint8_t> alpha,
                   std::span<std::uint8_t> depth);
  /// `rgba`, premultiplied, R lowest, becomes what the decoder will have. `alpha` is decoded.
  void color(std::span<const std::uint8_t> alpha, std::span<const std::uint32_t> predicted,
             std::span<std::uint32_t> rgba);
  void finish();

 private:
  [[nodiscard]] BlockPlane quantise(std::size_t plane, std::span<const std::uint8_t> wanted,
                                    std::span<const float> weight, std::vector<float>& difference);
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
  /// bad_file: the payload has another length than what it codes.
  [[nodiscard]] Result<void> finish() const;
};

}  // namespace slf::codec
