// Lanes: the samples of sixteen pictures side by side, and prediction for all of them at once.
//
// Restoring a sample needs its neighbours in the same picture, so the samples of one picture cannot
// be restored in parallel. But pictures do not depend on each other: sixteen are restored together,
// each in one vector lane. All values and sums are integers that floats represent exactly, so the
// order of operations does not matter and all machines give the same result.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "slf/error.h"

namespace slf::codec {

inline constexpr std::size_t kLaneCount = 16;

/// One sample, or residual, of each picture of a group.
using LaneValues = std::array<std::uint16_t, kLaneCount>;

/// Taps in the channel itself: W, N, NW, NE, WW, NN (FORMAT.md, "Neighbours").
inline constexpr std::size_t kOwnTaps = 6;
/// Taps in each channel restored earlier: the sample itself, and its W, N, NW, NE.
inline constexpr std::size_t kCrossTaps = 5;
inline constexpr std::size_t kMaxChannels = 3;
inline constexpr std::size_t kMaxTaps = kOwnTaps + kCrossTaps * 2;

/// The largest weight. It keeps a weighted sum of kMaxTaps bytes below 2^24, so a float is exact.
inline constexpr int kMaxTapWeight = 2047;

/// How one channel of a tile is predicted.
struct ChannelPredictor {
  bool linear = false;  ///< a weighted sum, for bytes only; otherwise the median edge detector
  std::array<std::int16_t, kMaxTaps> weights{};  ///< in 1/256; the first taps() count
};

/// The number of weights of channel `channel` in linear prediction. Channel 0 is restored first.
[[nodiscard]] constexpr std::size_t taps(std::size_t channel) {
  return kOwnTaps + kCrossTaps * channel;
}

/// The channels of a group: values and residuals are [channel][column][lane], each channel
/// `columns` long. All values are below 2^bits, bits 8 or 16.
struct LaneGroup {
  std::uint32_t side = 0;
  std::uint32_t bits = 8;
  std::span<const ChannelPredictor> channels;
};

/// Computes residuals = values - prediction, modulo 2^bits. `coverage` is [column][lane] or null.
/// Where it is 0 the value does not matter: its residual is 0, and as a neighbour of others it is
/// replaced by its prediction.
void predict(const LaneGroup& group, const LaneValues* values, const LaneValues* coverage,
             LaneValues* residuals);

/// Undoes predict. A value that did not matter becomes its prediction. All residuals below 2^bits
/// are safe.
void restore(const LaneGroup& group, const LaneValues* residuals, LaneValues* values);

}  // namespace slf::codec
