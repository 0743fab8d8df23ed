#include "codec/kept_rays.h"

#include <algorithm>
#include <cmath>

#include "codec/color_kernel.h"

namespace slf::codec {
namespace {

/// How far a kept ray may be from the samples: colours and depth in steps of their coarsest
/// coefficients, alpha in 1/255. Of rays that are equal, 99 % are nearer, because a coded sample
/// errs by as much.
constexpr float kColorSteps = 3, kDepthSteps = 1, kAlphaError = 18;
/// A ray between two kept ones may be as many times as far away.
constexpr float kBetween = 2;
/// What the errors of the rays of a block may have in common, in steps. Unlike noise, this would be
/// seen, because views do not average it away.
constexpr float kCommonSteps = 1;

std::uint32_t apart(std::uint32_t a, std::uint32_t b) { return a > b ? a - b : b - a; }
std::uint32_t channel(std::uint32_t rgba, std::size_t c) { return rgba >> 8 * c & 255; }

}  // namespace

std::uint32_t straight(std::uint32_t rgba) {
  const std::uint32_t alpha = rgba >> 24;
  if (alpha == 0) return kUnpredictedColor;
  std::uint32_t color = 0xFF000000u;
  for (std::size_t c = 0; c < 3; ++c)
    color |= std::min(255u, (channel(rgba, c) * 255 + alpha / 2) / alpha) << 8 * c;
  return color;
}

std::uint32_t difference(std::uint32_t rgba, std::uint8_t depth, std::uint8_t predicted_alpha,
                         std::uint8_t predicted_depth, std::uint32_t color) {
  const std::uint32_t alpha = rgba >> 24;
  std::uint32_t sum = 2 * apart(alpha, predicted_alpha);
  if (alpha == 0) return sum;
  sum += apart(depth, predicted_depth);
  for (std::size_t c = 0; c < 3; ++c)
    sum += apart(channel(rgba, c), premultiplied(channel(color, c), alpha));
  return sum;
}

void KeptRays::begin(const TileShape& tile, const Predicted& predicted) {
  const std::size_t count = tile.samples();
  side_ = tile.side, from_ = predicted.prediction;
  rgba_.resize(count), depth_.resize(count), likely_.resize(count), kept_.assign(count, 0);
  for (std::size_t s = 0; s < count; ++s) {
    rgba_[s] = load_le<std::uint32_t>(&predicted.earlier[4 * s]);
    depth_[s] = std::to_integer<std::uint8_t>(predicted.earlier[4 * count + s]);
    const std::uint32_t apart =
        difference(rgba_[s], depth_[s], from_.alpha[s], from_.depth[s], from_.color[s]);
    likely_[s] = apart < 2 ? 3 : apart < 8 ? 2 : apart < 32 ? 1 : 0;
  }
}

void KeptRays::choose(const PredictiveLevel& level, int scale, const TilePicture& picture,
                      std::span<const std::uint8_t> depth, std::span<const std::uint32_t> rgba) {
  const auto step = [&](std::size_t plane) {
    return static_cast<float>(level.steps_of(plane, scale)[0]) / float{kCoefficientScale};
  };
  const float color = step(kYPlane), deep = step(kDepthPlane);
  const std::size_t count = rgba.size(), across = picture.width() / 8;
  std::vector<float> error(count);                                // above 1: too far
  std::vector<std::array<float, 5>> sums(picture.pixels() / 64);  // of a block; last: of how many
  const auto block = [&](std::size_t s) {
    const std::size_t pixel = picture.pixel_of()[s];
    return pixel / picture.width() / 8 * across + pixel % picture.width() / 8;
  };
  for (std::size_t s = 0; s < count; ++s) {
    const auto apart = [&](std::size_t c) {
      return static_cast<float>(channel(rgba[s], c)) - static_cast<float>(channel(rgba_[s], c));
    };
    error[s] = std::abs(apart(3)) / kAlphaError;
    for (std::size_t c = 0; c < 3; ++c)
      error[s] = std::max(error[s], std::abs(apart(c)) / (kColorSteps * color));
    if (rgba[s] >> 24 >= 128)
      error[s] =
          std::max(error[s], std::abs(float(depth[s]) - float(depth_[s])) / (kDepthSteps * deep));
    if (error[s] > 1 || (rgba[s] >> 24 == 0 && rgba_[s] >> 24 == 0)) continue;
    auto& sum = sums[block(s)];
    for (std::size_t c = 0; c < 4; ++c) sum[c] += apart(c);
    ++sum[4];
  }
  for (std::size_t s = 0; s < count; ++s) {
    const auto& sum = sums[block(s)];
    const bool common = std::any_of(sum.begin(), sum.end() - 1, [&](float one) {
      return std::abs(one) > kCommonSteps * color * std::max(sum[4], 4.f);
    });
    const bool between =
        s > 0 && s + 1 < count && std::max(error[s - 1], error[s + 1]) <= 1 && error[s] <= kBetween;
    kept_[s] = !common && (error[s] <= 1 || between) ? 1 : 0;
  }
}

std::span<const std::uint8_t> KeptRays::others(const TilePicture& picture) {
  others_.assign(picture.covered().begin(), picture.covered().end());
  for (std::size_t s = 0; s < kept_.size(); ++s)
    if (kept_[s]) others_[picture.pixel_of()[s]] = 0;
  return others_;
}

Prediction KeptRays::prediction() {
  alpha_.assign(from_.alpha.begin(), from_.alpha.end());
  depths_.assign(from_.depth.begin(), from_.depth.end());
  color_.assign(from_.color.begin(), from_.color.end());
  for (std::size_t s = 0; s < kept_.size(); ++s) {
    if (!kept_[s]) continue;
    alpha_[s] = static_cast<std::uint8_t>(rgba_[s] >> 24);
    depths_[s] = depth_[s], color_[s] = straight(rgba_[s]);
  }
  return {alpha_, depths_, color_};
}

void KeptRays::restore(std::span<std::uint8_t> depth, std::span<std::uint32_t> rgba) const {
  for (std::size_t s = 0; s < kept_.size(); ++s)
    if (kept_[s]) depth[s] = depth_[s], rgba[s] = rgba_[s];
}

}  // namespace slf::codec
