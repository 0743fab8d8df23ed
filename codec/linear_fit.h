// LinearFit: computes the weights of the linear predictor by least squares.
#pragma once

#include <array>
#include <cstdint>

#include "codec/lanes.h"

namespace slf::codec {

/// Accumulates sums of products over samples, and solves for the weights. The sums are exact, and
/// the few operations that round are the same on every machine.
class LinearFit {
 public:
  /// 1..3 channels.
  explicit LinearFit(std::size_t channels) : channels_(channels) {}

  /// Adds a third of the samples of the first `lanes` pictures of a group. `values` are those of
  /// predict, below 256. Samples whose `coverage`, if given, is 0 are left out.
  void add(std::uint32_t side, std::size_t lanes, const LaneValues* values,
           const LaneValues* coverage);

  [[nodiscard]] ChannelPredictor solve(std::size_t channel) const;

 private:
  // Per channel: W, N, NW, NE, WW, NN and the sample itself.
  static constexpr std::size_t kTermsPerChannel = kOwnTaps + 1;
  static constexpr std::size_t kMaxTerms = kTermsPerChannel * 3;

  std::size_t channels_;
  std::array<std::array<double, kMaxTerms>, kMaxTerms> products_{};
};

}  // namespace slf::codec
