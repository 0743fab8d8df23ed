#include "codec/predict.h"

#include <algorithm>

namespace slf::codec {
namespace {

int median_edge(int left, int up, int corner) {
  const int low = std::min(left, up);
  const int high = std::max(left, up);
  return std::clamp(left + up - corner, low, high);
}

}  // namespace

void predict(std::span<const std::uint8_t> samples, std::uint32_t side,
             std::span<std::uint8_t> residuals) {
  const std::uint8_t* line = samples.data();
  const std::uint8_t* above = nullptr;
  std::uint8_t* out = residuals.data();
  for (std::uint32_t q = 0; q <= side; ++q) {
    const std::uint32_t length = side + 1 - q;
    out[0] = static_cast<std::uint8_t>(line[0] - (above ? above[0] : 0));
    for (std::uint32_t p = 1; p < length; ++p) {
      const int guess = above ? median_edge(line[p - 1], above[p], above[p - 1]) : line[p - 1];
      out[p] = static_cast<std::uint8_t>(line[p] - guess);
    }
    above = line;
    line += length;
    out += length;
  }
}

void restore(std::span<const std::uint8_t> residuals, std::uint32_t side,
             std::span<std::uint8_t> samples) {
  std::uint8_t* line = samples.data();
  const std::uint8_t* above = nullptr;
  const std::uint8_t* in = residuals.data();
  for (std::uint32_t q = 0; q <= side; ++q) {
    const std::uint32_t length = side + 1 - q;
    line[0] = static_cast<std::uint8_t>(in[0] + (above ? above[0] : 0));
    for (std::uint32_t p = 1; p < length; ++p) {
      const int guess = above ? median_edge(line[p - 1], above[p], above[p - 1]) : line[p - 1];
      line[p] = static_cast<std::uint8_t>(in[p] + guess);
    }
    above = line;
    line += length;
    in += length;
  }
}

}  // namespace slf::codec
