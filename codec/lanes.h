// Lanes: the samples of sixteen pictures side by side, and prediction that runs over all of them
// at once.
//
// Predicting a sample needs its neighbours in the same picture, so one picture cannot be restored
// in parallel with itself. Pictures do not depend on each other, though: sixteen are taken
// together, a vector lane each. Every value is an integer that a float holds exactly, whatever the
// order of operations, so all machines agree.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "slf/error.h"

namespace slf::codec {

inline constexpr std::size_t lane_count = 16;

/// One sample, or residual, of each picture of a group.
using LaneValues = std::array<std::uint16_t, lane_count>;

/// Own neighbours that the linear predictor weighs: W, N, NW, NE, WW, NN (FORMAT.md).
inline constexpr std::size_t own_taps = 6;
/// Taps in every channel restored before: the sample itself, and its W, N, NW, NE.
inline constexpr std::size_t cross_taps = 5;
inline constexpr std::size_t max_channels = 4;
inline constexpr std::size_t max_taps = own_taps + cross_taps * 2;

/// The largest weight: keeps a weighted sum of max_taps bytes below 2^24, exact in a float.
inline constexpr int max_weight = 2047;

/// How one channel of a tile is predicted.
struct ChannelPredictor {
  bool linear = false;  ///< a weighted sum, for bytes only; otherwise the median edge detector
  std::array<std::int16_t, max_taps> weights{};  ///< in 1/256; the first taps() count
};

/// Weights of channel `channel` (0 first restored) when it is predicted linearly.
[[nodiscard]] constexpr std::size_t taps(std::size_t channel) {
  return own_taps + cross_taps * channel;
}

/// The channels of a group: values and residuals are [channel][column][lane], each channel
/// `columns` long. All values are below 2^bits, bits 8 or 16.
struct LaneGroup {
  std::uint32_t side = 0;
  std::uint32_t bits = 8;
  std::span<const ChannelPredictor> channels;
};

/// residuals = values - prediction, modulo 2^bits. Where `coverage` [column][lane], if given, is 0
/// the value does not matter: its residual is 0 and the prediction takes its place.
void predict(const LaneGroup& group, const LaneValues* values, const LaneValues* coverage,
             LaneValues* residuals);

/// Undoes predict; a value that did not matter comes out as predicted. Any residuals below 2^bits
/// are safe.
void restore(const LaneGroup& group, const LaneValues* residuals, LaneValues* values);

}  // namespace slf::codec
