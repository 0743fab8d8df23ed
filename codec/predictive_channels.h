// The predictive codec without a transform (FORMAT.md, "Channels"): codes the difference from a
// prediction sample by sample, exactly or within a quantisation step. It serves lossless fields and
// half floats.
//
// It works in stages, as in codec/predictive.h:
//
//   ChannelDecoder decoder(level, tile, payload);
//   decoder.references(kinds, used);
//   decoder.code(kAlphaChannel, predicted, values);   // then kDepthChannel
//   ... predict colours ...
//   decoder.code(kGreenChannel, predicted, values);   // then red, then blue
//   decoder.finish();
//
// Payloads are untrusted; everything is in integers.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "codec/codec.h"
#include "codec/predictive_tables.h"
#include "codec/range_coder.h"
#include "codec/residual_coder.h"

namespace slf::codec {

/// In the order in which they are coded.
enum TileChannel : std::size_t {
  kAlphaChannel,
  kDepthChannel,
  kGreenChannel,
  kRedChannel,
  kBlueChannel
};
inline constexpr std::size_t kTileChannels = 5;

/// For each channel, the value of each sample of a tile. Depth is 0..255. The others are 0..255 in
/// rgba8, and ordered_half() of the half float in rgba16f.
using ChannelValues = std::array<std::vector<std::int32_t>, kTileChannels>;

/// A half float as an integer that grows with it, -32768..32767; and back.
[[nodiscard]] constexpr std::int32_t ordered_half(std::uint16_t bits) {
  return bits < 0x8000 ? bits : 0x7FFF - static_cast<std::int32_t>(bits);
}
[[nodiscard]] constexpr std::uint16_t half_of_ordered(std::int32_t ordered) {
  return static_cast<std::uint16_t>(ordered >= 0 ? ordered : 0x7FFF - ordered);
}

/// The columns next to one in a triangular picture; -1 where there is none.
struct ColumnNeighbours {
  enum { W, N, NW, NE, WW, NN, E, S, kCount };
  std::array<std::int16_t, kCount> at;
};

/// The common part of encoder and decoder. Keeps references to its arguments, which must outlive
/// it.
template <class Coder>
class ChannelCoder {
 protected:
  /// Most terms of a prediction: 12 of the channel itself, 5 of each channel of colour before it.
  static constexpr std::size_t kMaxTerms = 22;
  using Weights = std::array<std::int32_t, kMaxTerms>;

  template <class Bytes>
  ChannelCoder(const PredictiveLevel& level, const Tile& tile, Bytes& payload);

  /// Codes the residuals and replaces `values` by those that the decoder will have.
  void code_channel(TileChannel channel, Weights weights, const ChannelValues& predicted,
                    ChannelValues& values);
  /// Codes whether samples of zero alpha have coded colours, too. Must be called after alpha.
  void code_hidden(bool hidden) { hidden_ = coder_.even_bit(hidden); }

  /// Whether a sample of the channel is coded; if not, it is 0.
  [[nodiscard]] bool coded(TileChannel channel, const ChannelValues& values,
                           std::size_t sample) const {
    return channel == kAlphaChannel || values[kAlphaChannel][sample] != 0 ||
           (hidden_ && channel >= kGreenChannel);
  }
  [[nodiscard]] std::size_t term_count(TileChannel channel) const {
    return 12 + (channel > kGreenChannel ? 5 * (channel - kGreenChannel) : 0);
  }
  /// The terms of a sample's linear prediction: neighbours and predictions around it, as
  /// differences from the value predicted for it.
  void find_terms(TileChannel channel, const ChannelValues& predicted, const ChannelValues& values,
                  std::size_t row, std::size_t column, std::int32_t* terms) const;
  [[nodiscard]] std::int32_t step(TileChannel channel) const;
  /// The neighbourhood of a sample of alpha, if it is flat: all neighbours are 0 or all are opaque.
  struct FlatNeighbourhood {
    bool flat = false;
    std::int32_t value = 0;   ///< of the neighbours
    std::size_t context = 0;  ///< of the residual
  };
  [[nodiscard]] FlatNeighbourhood find_flat(const ChannelValues& predicted,
                                            const ChannelValues& values, std::size_t row,
                                            std::size_t column) const;
  /// A class of the magnitudes of the residuals around a sample, in this channel and in the colour
  /// channels coded before.
  [[nodiscard]] std::size_t activity(TileChannel channel, std::size_t row,
                                     std::size_t column) const;

  const PredictiveLevel& level_;
  const std::size_t rows_, columns_;
  const std::int32_t min_value_, max_value_;  // of the channels other than depth
  const std::int32_t opaque_;                 // the alpha that means opaque
  bool hidden_ = false;
  std::vector<ColumnNeighbours> neighbours_;  // per column
  std::vector<std::int32_t> errors_;          // per sample: the residual's magnitude
  std::vector<std::int32_t> color_errors_;    // their sum over the colour channels before
  LevelModels::Used used_;
  Coder coder_;
};

class ChannelEncoder : ChannelCoder<RangeEncoder> {
 public:
  /// Appends to `payload`.
  ChannelEncoder(const PredictiveLevel& level, const Tile& tile, Bytes& payload);

  void references(std::span<const std::uint8_t> kinds, std::span<const std::uint8_t> used);
  /// Replaces the values of `channel` by those that the decoder will have.
  void code(TileChannel channel, const ChannelValues& predicted, ChannelValues& values);
  void finish() { coder_.finish(); }

 private:
  [[nodiscard]] Weights fit(TileChannel channel, const ChannelValues& predicted,
                            const ChannelValues& values) const;
};

class ChannelDecoder : ChannelCoder<RangeDecoder> {
 public:
  ChannelDecoder(const PredictiveLevel& level, const Tile& tile, ByteSpan payload);

  void references(std::span<const std::uint8_t> kinds, std::span<std::uint8_t> used);
  /// Replaces the values of `channel`.
  void code(TileChannel channel, const ChannelValues& predicted, ChannelValues& values);
  /// bad_file: the payload is longer or shorter than the coded data.
  [[nodiscard]] Result<void> finish() const;
};

}  // namespace slf::codec
