// How probabilities are stored in the tables of the predictive codec: what train_predictive needs
// of them.
#pragma once

#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>

#include "codec/predictive_tables.h"
#include "codec/rans.h"

namespace slf::bench {

/// The stored weights of a model that is as near to `counts` as possible.
inline void store_weights(std::span<const double> counts, std::span<std::uint8_t> weights) {
  const double sum = std::accumulate(counts.begin(), counts.end(), 0.);
  for (std::size_t k = 0; k < counts.size(); ++k) {
    // A weight of 4, the least, is 1/4096.
    const double wanted = 16384 * counts[k] / sum;
    // Rare symbols cost little however coarse their weights are, but these fill the tables.
    const auto next = [](int weight) { return weight < 16 ? weight + 4 : weight + 1; };
    const auto off = [&](int weight) {
      return std::abs(codec::SymbolModel::weight_of(static_cast<std::uint8_t>(weight)) - wanted);
    };
    int best = 0;
    while (next(best) < codec::SymbolModel::kWeights && off(next(best)) < off(best))
      best = next(best);
    weights[k] = static_cast<std::uint8_t>(best);
  }
}

/// The byte that stands for the probability nearest to this one.
[[nodiscard]] inline std::uint8_t byte_of_probability(double probability) {
  std::size_t best = 0;
  double min_bits = 1e9;
  for (std::size_t byte = 0; byte < 256; ++byte) {
    const double p = codec::probability_of(static_cast<std::uint8_t>(byte)) / 65536.;
    const double bits = -probability * std::log2(p) - (1 - probability) * std::log2(1 - p);
    if (bits < min_bits) min_bits = bits, best = byte;
  }
  return static_cast<std::uint8_t>(best);
}

}  // namespace slf::bench
