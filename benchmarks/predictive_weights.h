// How probabilities are stored in the tables of the predictive codec: what train_predictive needs
// of that.
#pragma once

#include <cmath>
#include <cstdint>

#include "codec/predictive_tables.h"

namespace slf::bench {

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
