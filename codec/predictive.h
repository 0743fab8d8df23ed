// The predictive codec: codes opacity, depth and colour of a tile as differences from a prediction
// that the caller makes (FORMAT.md, "The predictive codec").
//
//   PredictiveDecoder decoder(level, scale, picture, payload);
//   decoder.references(kinds, used);       // which of the caller's candidates to predict from
//   ... predict alpha, depth and colours, not multiplied by alpha ...
//   decoder.decode({alpha, depth, color}, decoded_depth, rgba);
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
#include "codec/rans.h"
#include "slf/error.h"

namespace slf::codec {

class KeptRays;

/// The arrangement of a tile's samples in one picture, which is divided into 8 × 8 blocks. It
/// depends on the tile's rows and side only.
class TilePicture {
 public:
  explicit TilePicture(const TileShape& tile);

  [[nodiscard]] std::size_t width() const { return width_; }    ///< a multiple of 8
  [[nodiscard]] std::size_t height() const { return height_; }  ///< the same
  [[nodiscard]] std::size_t pixels() const { return width_ * height_; }
  [[nodiscard]] std::size_t samples() const { return pixel_of_.size(); }
  /// For each sample, the index of its pixel.
  [[nodiscard]] std::span<const std::uint32_t> pixel_of() const { return pixel_of_; }
  /// For each pixel, 255 if it holds a sample, else 0.
  [[nodiscard]] std::span<const std::uint8_t> covered() const { return covered_; }

 private:
  std::size_t width_, height_;
  std::vector<std::uint32_t> pixel_of_;
  std::vector<std::uint8_t> covered_;
};

/// The quantised blocks of a plane, row by row. Blocks that are not coded are zero.
using BlockPlane = std::vector<Block>;

/// The symbols of a tile, for training. Lists are empty where a part is not coded.
struct TileSymbols {
  std::size_t level_kind = 0;  ///< PredictiveLevel::kind
  std::vector<std::uint8_t> kinds, used;
  SymbolList alpha;  ///< levels of alpha
  std::array<SymbolList, kPlanes> planes;
  /// Sums of the products RR, RG, RB, GG, GB and BB of differences of colours.
  std::array<std::int64_t, 6> colors{};
};

/// Keeps references to its arguments, which must outlive it.
class PredictiveEncoder {
 public:
  /// Appends to `payload`.
  PredictiveEncoder(const PredictiveLevel& level, int scale, const TilePicture& picture,
                    Bytes& payload);

  /// Notes the symbols of the tile in `symbols`, if it is not null.
  void collect(TileSymbols* symbols) {
    symbols_ = symbols;
    if (symbols) symbols->level_kind = level_.kind;
  }

  /// Codes which candidates are used. `kinds`, in [0, kReferenceKinds), selects a model: candidates
  /// of one kind are used about equally often.
  void references(std::span<const std::uint8_t> kinds, std::span<const std::uint8_t> used);
  /// Codes which samples are kept from another state; encode() does not code these.
  void keep(KeptRays& rays);
  /// Codes all samples; `rgba` is premultiplied.
  void encode(const Prediction& prediction, std::span<const std::uint8_t> depth,
              std::span<const std::uint32_t> rgba);

 private:
  /// A way to code alpha.
  struct Alpha {
    std::vector<std::uint8_t> decoded;  // per sample
    SymbolList symbols;
    std::size_t set = 0;  // the set of models for levels, or the number of these for a plane
    double bits = 0;
  };
  [[nodiscard]] Alpha alpha_levels(const Prediction& prediction,
                                   std::span<const std::uint32_t> rgba) const;
  [[nodiscard]] Alpha soft_alpha(const Prediction& prediction, std::span<const std::uint32_t> rgba);
  [[nodiscard]] BlockPlane quantise(std::size_t plane, std::span<const std::uint8_t> coded,
                                    std::span<const float> weight, std::vector<float>& difference,
                                    float round_up_from) const;
  [[nodiscard]] SymbolList list_plane(std::span<const std::uint8_t> coded, BlockPlane& blocks);
  void encode_plane(std::size_t plane, const SymbolList& symbols);
  void encode_depth(const Prediction& prediction, std::span<const std::uint8_t> alpha, bool soft,
                    std::span<const std::uint8_t> visible, std::span<const std::uint32_t> rgba,
                    std::span<const std::uint8_t> depth);
  void encode_color(const Prediction& prediction, std::span<const std::uint8_t> alpha,
                    std::span<const std::uint8_t> visible, std::span<const std::uint32_t> rgba);

  const PredictiveLevel& level_;
  const int scale_;
  const TilePicture& picture_;
  RansEncoder coder_;
  std::span<const std::uint8_t> coded_;  // for each pixel, 255 if it holds a sample that is coded
  std::vector<BlockState> states_;       // of the plane that was coded last; at first all 0
  TileSymbols* symbols_ = nullptr;
};

/// Keeps references to its arguments, which must outlive it. Allocates nothing once a thread has
/// decoded a tile of the same size.
class PredictiveDecoder {
 public:
  PredictiveDecoder(const PredictiveLevel& level, int scale, const TilePicture& picture,
                    ByteSpan payload);

  void references(std::span<const std::uint8_t> kinds, std::span<std::uint8_t> used);
  void keep(KeptRays& rays);
  /// Decodes all samples, colours premultiplied. bad_file: the payload is damaged, as far as that
  /// can be seen; samples are then any.
  [[nodiscard]] Result<void> decode(const Prediction& prediction, std::span<std::uint8_t> depth,
                                    std::span<std::uint32_t> rgba);

 private:
  struct Work;

  void decode_levels(std::size_t set, const Prediction& prediction, Work& work);
  void decode_soft_alpha(const Prediction& prediction, Work& work);
  [[nodiscard]] bool decode_plane(std::size_t plane, std::span<const std::uint8_t> coded,
                                  Work& work);

  const PredictiveLevel& level_;
  const int scale_;
  const TilePicture& picture_;
  RansDecoder coder_;
  std::span<const std::uint8_t> coded_;  // for each pixel, 255 if it holds a sample that is coded
};

}  // namespace slf::codec
