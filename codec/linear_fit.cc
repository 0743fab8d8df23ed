#include "codec/linear_fit.h"

#include <algorithm>
#include <cmath>

#include "base/tile_shape.h"
#include "codec/linear_system.h"

namespace slf::codec {
namespace {

// The columns of a sample's neighbours, replaced as in lanes.cc. REQUIRES: p > 0 or q > 0.
std::array<std::size_t, kOwnTaps> neighbours(std::uint32_t side, std::uint32_t p, std::uint32_t q,
                                             std::size_t column) {
  const std::size_t above = column - (side + 2 - q);  // line q - 1 holds side + 2 - q samples
  const std::size_t w = p > 0 ? column - 1 : above;
  const std::size_t n = q > 0 ? above : w;
  const std::size_t nw = p > 0 && q > 0 ? above - 1 : n;
  const std::size_t ne = q > 0 ? above + 1 : n;
  const std::size_t ww = p > 1 ? column - 2 : w;
  const std::size_t nn = q > 1 ? above - (side + 3 - q) : n;
  return {w, n, nw, ne, ww, nn};
}

}  // namespace

void LinearFit::add(std::uint32_t side, std::size_t lanes, const LaneValues* values,
                    const LaneValues* coverage) {
  const std::size_t columns = triangle_size(side);
  const std::size_t terms = kTermsPerChannel * channels_;
  std::array<double, kMaxTerms> term{};
  std::size_t column = 1;  // the first sample has no neighbours
  for (std::uint32_t q = 0; q <= side; ++q)
    for (std::uint32_t p = q == 0 ? 1 : 0; p <= side - q; ++p, ++column) {
      const auto around = neighbours(side, p, q, column);
      for (std::size_t lane = column % 3; lane < lanes; lane += 3) {
        if (coverage && coverage[column][lane] == 0) continue;
        double* next = term.data();
        for (std::size_t channel = 0; channel < channels_; ++channel) {
          const LaneValues* plane = values + channel * columns;
          for (const std::size_t at : around) *next++ = plane[at][lane];
          *next++ = plane[column][lane];
        }
        for (std::size_t i = 0; i < terms; ++i)
          for (std::size_t j = 0; j < terms; ++j) products_[i][j] += term[i] * term[j];
      }
    }
}

ChannelPredictor LinearFit::solve(std::size_t channel) const {
  // Select the terms that are taps of this channel, in the order of its weights.
  std::array<std::size_t, kMaxTaps> tap{};
  std::size_t count = 0;
  for (std::size_t i = 0; i < kOwnTaps; ++i) tap[count++] = channel * kTermsPerChannel + i;
  for (std::size_t earlier = 0; earlier < channel; ++earlier) {
    tap[count++] = earlier * kTermsPerChannel + kOwnTaps;
    for (std::size_t i = 0; i + 1 < kCrossTaps; ++i) tap[count++] = earlier * kTermsPerChannel + i;
  }
  const std::size_t target = channel * kTermsPerChannel + kOwnTaps;

  std::array<std::array<double, kMaxTaps + 1>, kMaxTaps> system{};
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t j = 0; j < count; ++j) system[i][j] = products_[tap[i]][tap[j]];
    system[i][i] += 1;  // keeps the system definite if all samples are equal
    system[i][count] = products_[tap[i]][target];
  }
  solve_system(system, count);

  ChannelPredictor predictor{true, {}};
  for (std::size_t i = 0; i < count; ++i) {
    const double weight = std::nearbyint(
        std::clamp(system[i][count] * 256, -double{kMaxTapWeight}, double{kMaxTapWeight}));
    predictor.weights[i] = static_cast<std::int16_t>(weight);
  }
  return predictor;
}

}  // namespace slf::codec
