#include "codec/predictive.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "codec/color_difference.h"
#include "codec/fill.h"
#include "codec/jpeg_pictures.h"
#include "codec/mosaic.h"
#include "codec/premultiply.h"
#include "codec/reference_coder.h"
#include "codec/zigzag.h"

namespace slf::codec {
namespace {

/// The squared error of alpha that is worth one bit, at a quantisation step of 1.
constexpr double kErrorPerBit = 0.15;

/// A coefficient is rounded up from this fraction of a step on. One half: no rate-distortion
/// optimisation, because a zeroed coefficient leaves similar errors in neighbouring rows, while
/// rounding errors cancel when views blend rows.
constexpr float kRoundUpFrom = 0.5f;
/// The same for depth where alpha is soft. There, depth is only a mean along the ray.
constexpr float kRoundSoftDepthUpFrom = 0.7f;

/// Rounds values near 0 or 255 to these, so that errors of the transform leave no haze.
std::uint8_t snapped(int alpha) {
  return static_cast<std::uint8_t>(alpha <= 2 ? 0 : alpha >= 253 ? 255 : alpha);
}

}  // namespace

TilePicture::TilePicture(const Tile& tile) {
  const Mosaic mosaic(tile.rows(), tile.side, 8);
  width_ = mosaic.width(), height_ = mosaic.height();
  pixel_of_.resize(tile.rows() * tile.columns());
  covered_.resize(pixels());
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    pixel_of_[sample] = static_cast<std::uint32_t>(pixel);
    covered_[pixel] = 1;
  });
}

template <class Coder>
template <class Bytes>
PredictiveTile<Coder>::PredictiveTile(const PredictiveLevel& level, const TilePicture& picture,
                                      Bytes& payload)
    : level_(level), picture_(picture), models_(level.models), coder_(payload) {}

template <class Coder>
BlockPlane PredictiveTile<Coder>::empty_plane() const {
  BlockPlane plane;
  plane.across = picture_.width() / 8;
  plane.blocks.resize(picture_.pixels() / 64);
  plane.counts.resize(plane.blocks.size());
  return plane;
}

/// For each block, 1 if it has a visible sample. Other blocks are not coded. `pixels` are 0 where
/// nothing is visible.
template <class Coder>
std::vector<std::uint8_t> PredictiveTile<Coder>::visible_blocks(
    std::span<const std::uint8_t> pixels) const {
  std::vector<std::uint8_t> blocks(picture_.pixels() / 64);
  const std::size_t across = picture_.width() / 8;
  for (std::size_t y = 0; y < picture_.height(); ++y)
    for (std::size_t x = 0; x < across; ++x) {
      std::uint64_t eight = 0;
      std::memcpy(&eight, &pixels[8 * (y * across + x)], 8);
      if (eight != 0) blocks[y / 8 * across + x] = 1;
    }
  return blocks;
}

template <class Coder>
std::vector<std::int16_t> PredictiveTile<Coder>::code_plane(std::size_t plane,
                                                            std::span<const std::uint8_t> coded,
                                                            BlockPlane& blocks) {
  const std::size_t kind = std::min<std::size_t>(plane, kChromaPlane);
  const std::array<std::int32_t, 64> steps = level_.steps[kind].steps();
  std::vector<std::int16_t> pixels(picture_.pixels());
  bool differs = false;
  for (std::size_t b = 0; b < blocks.blocks.size(); ++b) {
    if (!coded[b]) continue;
    code_block(coder_, models_.planes[kind], blocks, b);
    if (blocks.counts[b] == 0) continue;
    differs = true;
    const std::size_t x = b % blocks.across * 8, y = b / blocks.across * 8;
    restore_block(blocks.blocks[b], blocks.counts[b], steps, &pixels[y * picture_.width() + x],
                  picture_.width());
  }
  std::vector<std::int16_t> differences(picture_.samples());
  if (!differs) return differences;
  const auto pixel_of = picture_.pixel_of();
  for (std::size_t s = 0; s < differences.size(); ++s) differences[s] = pixels[pixel_of[s]];
  return differences;
}

template <class Coder>
void PredictiveTile<Coder>::code_alpha(bool soft, std::span<std::uint8_t> levels,
                                       BlockPlane& blocks, std::span<std::uint8_t> alpha) {
  const auto pixel_of = picture_.pixel_of();
  if (coder_.bit(models_.soft, soft)) {
    const auto differences =
        code_plane(kAlphaPlane, std::vector<std::uint8_t>(blocks.blocks.size(), 1), blocks);
    std::vector<std::uint8_t> pixels(picture_.pixels());
    for (std::size_t s = 0; s < alpha.size(); ++s) {
      alpha[s] = snapped(alpha[s] + differences[s]);
      pixels[pixel_of[s]] = alpha[s];
    }
    visible_ = visible_blocks(pixels);
    return;
  }
  std::vector<std::uint8_t> prediction(picture_.pixels());
  for (std::size_t s = 0; s < alpha.size(); ++s) prediction[pixel_of[s]] = alpha[s];
  slf::codec::code_alpha(
      coder_, models_.alpha,
      {picture_.width(), picture_.height(), picture_.covered(), prediction, levels});
  for (std::size_t s = 0; s < alpha.size(); ++s) alpha[s] = kAlphaValues[levels[pixel_of[s]]];
  visible_ = visible_blocks(levels);
}

template <class Coder>
void PredictiveTile<Coder>::code_depth(BlockPlane& blocks, std::span<const std::uint8_t> alpha,
                                       std::span<std::uint8_t> depth) {
  const auto differences = code_plane(kDepthPlane, visible_, blocks);
  const std::int16_t* const difference = differences.data();  // so that the loop is vectorised
  for (std::size_t s = 0; s < alpha.size(); ++s) {
    const int value = std::clamp(depth[s] + difference[s], 0, 255);
    depth[s] = static_cast<std::uint8_t>(alpha[s] == 0 ? 0 : value);
  }
}

template <class Coder>
void PredictiveTile<Coder>::code_color(std::array<BlockPlane, 3>& blocks,
                                       std::span<const std::uint8_t> alpha,
                                       std::span<const std::uint32_t> predicted,
                                       std::span<std::uint32_t> rgba) {
  std::array<std::vector<std::int16_t>, 3> differences;
  for (std::size_t c = 0; c < 3; ++c)
    differences[c] = code_plane(kLumaPlane + c, visible_, blocks[c]);
  std::copy(predicted.begin(), predicted.end(), rgba.begin());
  if (level_.premultiplied) premultiply(rgba, alpha);
  add_differences({differences[0], differences[1], differences[2]}, rgba);
  if (!level_.premultiplied) premultiply(rgba, alpha);
}

PredictiveEncoder::PredictiveEncoder(const PredictiveLevel& level, const TilePicture& picture,
                                     Bytes& payload)
    : PredictiveTile(level, picture, payload) {}

void PredictiveEncoder::count(BitCounts* counts) { coder_.count(models_.begin(), counts); }

void PredictiveEncoder::references(std::span<const std::uint8_t> kinds,
                                   std::span<const std::uint8_t> used) {
  std::vector<std::uint8_t> coded(used.begin(), used.end());
  code_references(coder_, models_.used, kinds, coded);
}

/// Quantises `difference`, the wanted correction of each pixel's prediction. Pixels of weight 0 may
/// get any correction.
BlockPlane PredictiveEncoder::quantise(std::size_t plane, std::span<const std::uint8_t> coded,
                                       std::span<const float> weight,
                                       std::vector<float>& difference, float round_up_from) {
  fill(picture_.width(), picture_.height(), weight, difference);
  const auto steps = level_.steps[std::min<std::size_t>(plane, kChromaPlane)].steps();
  BlockPlane blocks = empty_plane();
  for (std::size_t b = 0; b < blocks.blocks.size(); ++b) {
    if (!coded[b]) continue;
    const std::size_t x = b % blocks.across * 8, y = b / blocks.across * 8;
    std::array<float, 64> values;
    for (std::size_t k = 0; k < 64; ++k)
      values[k] = difference[(y + k / 8) * picture_.width() + x + k % 8];
    const std::array<float, 64> coefficients = forward_dct(values);
    for (std::size_t place = 0; place < 64; ++place) {
      const std::size_t k = kZigzag[place];
      const float steps_away =
          std::floor(std::abs(coefficients[k]) / static_cast<float>(steps[k]) + 1 - round_up_from);
      const auto value = static_cast<std::int16_t>(std::min(steps_away, kMaxCoefficient));
      blocks.blocks[b][k] = coefficients[k] < 0 ? static_cast<std::int16_t>(-value) : value;
      if (value != 0) blocks.counts[b] = static_cast<std::uint8_t>(place + 1);
    }
  }
  return blocks;
}

/// The cost of one of the two ways to code alpha: squared error plus bits, weighted.
double PredictiveEncoder::alpha_cost(bool soft, std::vector<std::uint8_t> levels, BlockPlane blocks,
                                     std::span<const std::uint8_t> true_alpha,
                                     std::span<const std::uint8_t> predicted) const {
  Bytes scratch;
  PredictiveEncoder trial(level_, picture_, scratch);
  std::vector<std::uint8_t> alpha(predicted.begin(), predicted.end());
  trial.code_alpha(soft, levels, blocks, alpha);
  trial.finish();
  double error = 0;
  for (std::size_t s = 0; s < alpha.size(); ++s) {
    const double off = static_cast<double>(alpha[s]) - static_cast<double>(true_alpha[s]);
    error += off * off;
  }
  const double step = level_.steps[kAlphaPlane].low / static_cast<double>(kCoefficientScale);
  return error + kErrorPerBit * step * step * 8 * static_cast<double>(scratch.size());
}

void PredictiveEncoder::alpha_depth(std::span<const std::uint8_t> true_alpha,
                                    std::span<const std::uint8_t> true_depth,
                                    std::span<std::uint8_t> alpha, std::span<std::uint8_t> depth) {
  const auto pixel_of = picture_.pixel_of();
  std::vector<float> weight(picture_.pixels()), difference(picture_.pixels());
  std::vector<std::uint8_t> levels(picture_.pixels());
  for (std::size_t s = 0; s < alpha.size(); ++s) {
    levels[pixel_of[s]] = static_cast<std::uint8_t>(alpha_level(true_alpha[s]));
    weight[pixel_of[s]] = 1;
    difference[pixel_of[s]] = static_cast<float>(true_alpha[s]) - static_cast<float>(alpha[s]);
  }
  BlockPlane blocks = empty_plane();
  blocks = quantise(kAlphaPlane, std::vector<std::uint8_t>(blocks.blocks.size(), 1), weight,
                    difference, kRoundUpFrom);
  const bool soft = alpha_cost(true, levels, blocks, true_alpha, alpha) <
                    alpha_cost(false, levels, blocks, true_alpha, alpha);
  code_alpha(soft, levels, blocks, alpha);

  for (std::size_t s = 0; s < alpha.size(); ++s) {
    weight[pixel_of[s]] = alpha[s] > 0 && true_alpha[s] > 0 ? 1.f : 0.f;
    difference[pixel_of[s]] = static_cast<float>(true_depth[s]) - static_cast<float>(depth[s]);
  }
  blocks = quantise(kDepthPlane, visible_, weight, difference,
                    soft ? kRoundSoftDepthUpFrom : kRoundUpFrom);
  code_depth(blocks, alpha, depth);
}

void PredictiveEncoder::color(std::span<const std::uint8_t> alpha,
                              std::span<const std::uint32_t> predicted,
                              std::span<std::uint32_t> rgba) {
  const auto pixel_of = picture_.pixel_of();
  std::vector<float> weight(picture_.pixels());
  std::array<std::vector<float>, 3> difference;
  for (auto& plane : difference) plane.resize(picture_.pixels());
  for (std::size_t s = 0; s < alpha.size(); ++s) {
    const std::uint32_t opacity = rgba[s] >> 24;
    if (alpha[s] == 0 || (opacity == 0 && !level_.premultiplied)) continue;
    const auto differs = [&](std::uint32_t shift) {
      const std::uint32_t from = predicted[s] >> shift & 255;
      const auto color = static_cast<float>(rgba[s] >> shift & 255);
      return level_.premultiplied
                 ? color - static_cast<float>(premultiplied(from, alpha[s]))
                 : color * 255.f / static_cast<float>(opacity) - static_cast<float>(from);
    };
    const float r = differs(0), g = differs(8), b = differs(16);
    const float y = 0.299f * r + 0.587f * g + 0.114f * b;
    // Detail in hardly visible matter is mostly noise, which views do not reproduce.
    weight[pixel_of[s]] = std::sqrt(static_cast<float>(alpha[s]) / 255.f);
    difference[0][pixel_of[s]] = y;
    difference[1][pixel_of[s]] = (b - y) / 1.772f;
    difference[2][pixel_of[s]] = (r - y) / 1.402f;
  }
  std::array<BlockPlane, 3> blocks;
  for (std::size_t c = 0; c < 3; ++c)
    blocks[c] = quantise(kLumaPlane + c, visible_, weight, difference[c], kRoundUpFrom);
  code_color(blocks, alpha, predicted, rgba);
}

void PredictiveEncoder::finish() { coder_.finish(); }

PredictiveDecoder::PredictiveDecoder(const PredictiveLevel& level, const TilePicture& picture,
                                     ByteSpan payload)
    : PredictiveTile(level, picture, payload) {}

void PredictiveDecoder::references(std::span<const std::uint8_t> kinds,
                                   std::span<std::uint8_t> used) {
  code_references(coder_, models_.used, kinds, used);
}

void PredictiveDecoder::alpha_depth(std::span<std::uint8_t> alpha, std::span<std::uint8_t> depth) {
  std::vector<std::uint8_t> levels(picture_.pixels());
  BlockPlane blocks = empty_plane();
  code_alpha(false, levels, blocks, alpha);
  blocks = empty_plane();
  code_depth(blocks, alpha, depth);
}

void PredictiveDecoder::color(std::span<const std::uint8_t> alpha,
                              std::span<const std::uint32_t> predicted,
                              std::span<std::uint32_t> rgba) {
  std::array<BlockPlane, 3> blocks{empty_plane(), empty_plane(), empty_plane()};
  code_color(blocks, alpha, predicted, rgba);
}

Result<void> PredictiveDecoder::finish() const {
  if (coder_.finished()) return {};
  return fail(ErrorCode::bad_file, "the payload does not end where its content does");
}

}  // namespace slf::codec
