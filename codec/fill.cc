#include "codec/fill.h"

#include <algorithm>
#include <limits>
#include <vector>

namespace slf::codec {
namespace {

// The inner loops have no branches, so that compilers put them on vectors.

/// The weighted means of 2 × 2 pixels: of `count` pixels of each of two rows. Weights are at
/// most 1.
void push_row(std::size_t count, const float* __restrict a, const float* __restrict a_weight,
              const float* __restrict b, const float* __restrict b_weight, float* __restrict values,
              float* __restrict weight) {
  const auto store = [&](std::size_t to, float sum, float total) {
    values[to] = sum / std::max(total, std::numeric_limits<float>::min());
    weight[to] = std::min(total, 1.0f);
  };
  for (std::size_t x = 0; x < count / 2; ++x) {
    const std::size_t u = 2 * x, v = u + 1;
    store(x, a_weight[u] * a[u] + a_weight[v] * a[v] + b_weight[u] * b[u] + b_weight[v] * b[v],
          a_weight[u] + a_weight[v] + b_weight[u] + b_weight[v]);
  }
  if (count % 2 == 0) return;
  const std::size_t u = count - 1;
  store(count / 2, a_weight[u] * a[u] + b_weight[u] * b[u], a_weight[u] + b_weight[u]);
}

/// Blends a row of `count` pixels with the coarse picture's values: 9, 3, 3 and 1 sixteenths of the
/// nearest four pixels, which are in the rows `near` and `far`.
void pull_row(std::size_t count, const float* __restrict near, const float* __restrict far,
              const float* __restrict weight, float* __restrict values) {
  const auto blend = [&](std::size_t x, std::size_t u, std::size_t beside) {
    const float coarse = (9 * near[u] + 3 * near[beside] + 3 * far[u] + far[beside]) * (1.0f / 16);
    values[x] = weight[x] * values[x] + (1 - weight[x]) * coarse;
  };
  const std::size_t last = (count - 1) / 2;
  blend(0, 0, 0);
  if (count > 1) blend(1, 0, std::min<std::size_t>(1, last));
  for (std::size_t u = 1; u < last; ++u) {
    blend(2 * u, u, u - 1);
    blend(2 * u + 1, u, u + 1);
  }
  if (last == 0) return;
  blend(2 * last, last, last - 1);
  if (count % 2 == 0) blend(2 * last + 1, last, last);
}

}  // namespace

void fill(std::size_t width, std::size_t height, std::span<const float> weight,
          std::span<float> values) {
  const auto certain = [](float w) { return w >= 1; };
  if (width * height <= 1 || std::all_of(weight.begin(), weight.end(), certain)) return;
  const std::size_t across = (width + 1) / 2, down = (height + 1) / 2;
  std::vector<float> coarse(across * down), coarse_weight(coarse.size());
  const std::vector<float> nothing(height % 2 * width);  // the row below the last one
  for (std::size_t v = 0; v < down; ++v) {
    const std::size_t y = 2 * v * width, below = y + width;
    const bool odd = below == values.size();
    push_row(width, &values[y], &weight[y], odd ? nothing.data() : &values[below],
             odd ? nothing.data() : &weight[below], &coarse[v * across],
             &coarse_weight[v * across]);
  }
  const auto none = [](float w) { return w == 0; };
  if (std::all_of(coarse_weight.begin(), coarse_weight.end(), none)) return;
  fill(across, down, coarse_weight, coarse);
  for (std::size_t y = 0; y < height; ++y) {
    const std::size_t near = y / 2, above = near - std::min<std::size_t>(near, 1);
    const std::size_t far = y % 2 == 0 ? above : std::min(near + 1, down - 1);
    pull_row(width, &coarse[near * across], &coarse[far * across], &weight[y * width],
             &values[y * width]);
  }
}

}  // namespace slf::codec
