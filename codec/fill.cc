#include "codec/fill.h"

#include <algorithm>
#include <vector>

namespace slf::codec {
namespace {

struct Level {
  std::size_t width, height;
  std::vector<float> values, weight;
};

// Weighted means of 2 × 2 pixels. Weights are at most 1.
Level push(std::size_t width, std::size_t height, std::span<const float> values,
           std::span<const float> weight) {
  Level half{(width + 1) / 2, (height + 1) / 2, {}, {}};
  half.values.resize(half.width * half.height);
  half.weight.resize(half.values.size());
  for (std::size_t y = 0; y < half.height; ++y)
    for (std::size_t x = 0; x < half.width; ++x) {
      float sum = 0, total = 0;
      for (std::size_t v = 2 * y; v < std::min(2 * y + 2, height); ++v)
        for (std::size_t u = 2 * x; u < std::min(2 * x + 2, width); ++u) {
          sum += weight[v * width + u] * values[v * width + u];
          total += weight[v * width + u];
        }
      half.values[y * half.width + x] = total > 0 ? sum / total : 0;
      half.weight[y * half.width + x] = std::min(total, 1.0f);
    }
  return half;
}

// The coarse picture's value at a fine pixel: 9, 3, 3 and 1 sixteenths of the nearest four pixels.
float pull(const Level& coarse, std::size_t x, std::size_t y) {
  const std::size_t u = x / 2, v = y / 2;
  const auto beside = [](std::size_t fine, std::size_t at, std::size_t size) {
    return fine % 2 == 0 ? (at > 0 ? at - 1 : at) : std::min(at + 1, size - 1);
  };
  const std::size_t u2 = beside(x, u, coarse.width), v2 = beside(y, v, coarse.height);
  const auto at = [&](std::size_t i, std::size_t j) { return coarse.values[j * coarse.width + i]; };
  return (9 * at(u, v) + 3 * at(u2, v) + 3 * at(u, v2) + at(u2, v2)) * (1.0f / 16);
}

}  // namespace

void fill(std::size_t width, std::size_t height, std::span<const float> weight,
          std::span<float> values) {
  const auto certain = [](float w) { return w >= 1; };
  if (width * height <= 1 || std::all_of(weight.begin(), weight.end(), certain)) return;
  Level coarse = push(width, height, values, weight);
  if (std::all_of(coarse.weight.begin(), coarse.weight.end(), [](float w) { return w == 0; }))
    return;
  fill(coarse.width, coarse.height, coarse.weight, coarse.values);
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x) {
      const std::size_t i = y * width + x;
      if (weight[i] < 1) values[i] = weight[i] * values[i] + (1 - weight[i]) * pull(coarse, x, y);
    }
}

}  // namespace slf::codec
