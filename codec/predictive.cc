#include "codec/predictive.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <tuple>

#include "base/per_thread.h"
#include "codec/color_kernel.h"
#include "codec/fill.h"
#include "codec/jpeg_pictures.h"
#include "codec/kept_rays.h"
#include "codec/mosaic.h"
#include "codec/reference_coder.h"
#include "codec/scratch.h"

namespace slf::codec {
namespace {

/// The squared error of alpha that is worth one bit, at a quantisation step of 1.
constexpr double kAlphaErrorPerBit = 0.15;

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

/// From differences of R, G and B to those of the coded planes.
std::array<float, 9> inverse(const ColorMatrix& matrix) {
  std::array<float, 9> inverse{};
  for (std::size_t k = 0; k < 9; ++k)
    inverse[k] = static_cast<float>(256 * static_cast<double>(adjugate(matrix)[k]) /
                                    static_cast<double>(determinant(matrix)));
  return inverse;
}

/// For each block, 1 if it has a visible sample that is `coded`. Other blocks are not coded.
/// `pixels` are 0 where nothing is visible.
void find_visible(const TilePicture& picture, std::span<const std::uint8_t> pixels,
                  std::span<const std::uint8_t> coded, std::span<std::uint8_t> visible) {
  std::fill(visible.begin(), visible.end(), std::uint8_t{0});
  const std::size_t across = picture.width() / 8;
  for (std::size_t y = 0; y < picture.height(); ++y)
    for (std::size_t x = 0; x < across; ++x) {
      std::uint64_t eight = 0, among = 0;
      std::memcpy(&eight, &pixels[8 * (y * across + x)], 8);
      std::memcpy(&among, &coded[8 * (y * across + x)], 8);
      visible[y / 8 * across + x] |= (eight & among) != 0 ? 1 : 0;
    }
}

/// The levels of a prediction of alpha, of each pixel; `prediction` is 0 where none holds a sample.
void find_expected(std::span<const std::uint8_t> prediction, std::span<std::uint8_t> expected) {
  for (std::size_t k = 0; k < expected.size(); ++k) expected[k] = alpha_level(prediction[k]);
}

/// Adds the differences of the blocks of a plane to pixels, which are 0.
void restore(const Block& block, std::size_t groups, const std::array<std::int32_t, 64>& steps,
             const TilePicture& picture, std::size_t index, std::span<std::int16_t> pixels) {
  const std::size_t across = picture.width() / 8;
  const std::size_t x = index % across * 8, y = index / across * 8;
  restore_block(block, 4 * groups, steps, &pixels[y * picture.width() + x], picture.width());
}

/// The states of the blocks around block `index`.
struct Around {
  const BlockState& left;
  const BlockState& above;

  Around(std::span<const BlockState> states, std::size_t across, std::size_t index)
      : left(index % across != 0 ? states[index - 1] : kNone),
        above(index >= across ? states[index - across] : kNone) {}
  static constexpr BlockState kNone{};
};

/// The set of models that codes a list in the fewest bits, and their number.
std::pair<std::size_t, double> best_set(const SymbolList& symbols,
                                        std::span<const std::shared_ptr<const ModelSet>> sets) {
  std::pair<std::size_t, double> best{0, std::numeric_limits<double>::max()};
  for (std::size_t set = 0; set < sets.size(); ++set)
    if (const double bits = symbols.cost(sets[set]->models()); bits < best.second)
      best = {set, bits};
  return best;
}

}  // namespace

TilePicture::TilePicture(const TileShape& tile) {
  const Mosaic mosaic(tile.rows(), tile.side, 8);
  width_ = mosaic.width(), height_ = mosaic.height();
  pixel_of_.resize(tile.rows() * tile.columns());
  covered_.resize(pixels());
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    pixel_of_[sample] = static_cast<std::uint32_t>(pixel);
    covered_[pixel] = 255;
  });
}

PredictiveEncoder::PredictiveEncoder(const PredictiveLevel& level, int scale,
                                     const TilePicture& picture, Bytes& payload)
    : level_(level),
      scale_(scale),
      picture_(picture),
      coder_(payload),
      coded_(picture.covered()),
      states_(picture.pixels() / 64) {}

void PredictiveEncoder::references(std::span<const std::uint8_t> kinds,
                                   std::span<const std::uint8_t> used) {
  std::vector<std::uint8_t> coded(used.begin(), used.end());
  code_references(coder_, level_.level_models().used, kinds, coded);
  if (symbols_) symbols_->kinds.assign(kinds.begin(), kinds.end()), symbols_->used = coded;
}

void PredictiveEncoder::keep(KeptRays& rays) {
  rays.code(coder_);
  coded_ = rays.others(picture_);
}

/// Quantises `difference`, the wanted correction of each pixel's prediction. Pixels of weight 0 may
/// get any correction.
BlockPlane PredictiveEncoder::quantise(std::size_t plane, std::span<const std::uint8_t> coded,
                                       std::span<const float> weight,
                                       std::vector<float>& difference, float round_up_from) const {
  fill(picture_.width(), picture_.height(), weight, difference);
  const std::array<std::int32_t, 64> steps = level_.steps_of(plane, scale_);
  const std::size_t across = picture_.width() / 8;
  BlockPlane blocks(coded.size());
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    if (!coded[b]) continue;
    const std::size_t x = b % across * 8, y = b / across * 8;
    const std::array<float, 64> coefficients =
        forward_dct(&difference[y * picture_.width() + x], picture_.width());
    for (std::size_t k = 0; k < 64; ++k) {  // without calls or branches: on vectors
      const float steps_away =
          std::abs(coefficients[k]) / static_cast<float>(steps[k]) + 1 - round_up_from;
      const auto value = static_cast<std::int32_t>(std::min(steps_away, kMaxCoefficient));
      blocks[b][k] = static_cast<std::int16_t>(coefficients[k] < 0 ? -value : value);
    }
  }
  return blocks;
}

/// Sets states_ to those of the plane. The list is empty if all blocks are 0.
SymbolList PredictiveEncoder::list_plane(std::span<const std::uint8_t> coded, BlockPlane& blocks) {
  SymbolList symbols;
  std::vector<BlockState> states(coded.size());
  const std::size_t across = picture_.width() / 8;
  bool differs = false;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    if (!coded[b]) continue;
    const Around around(states, across, b);
    code_block(symbols, around.left, around.above, states_[b], states[b], blocks[b]);
    differs |= states[b].length > 0;
  }
  states_ = std::move(states);
  return differs ? symbols : SymbolList();
}

void PredictiveEncoder::encode_plane(std::size_t plane, const SymbolList& symbols) {
  const std::size_t set = symbols.entries().empty()
                              ? level_.models->block_sets
                              : best_set(symbols, level_.models->blocks).first;
  coder_.symbol(level_.level_models().block_set[plane], static_cast<std::uint32_t>(set));
  if (!symbols.entries().empty()) coder_.list(symbols, level_.models->blocks[set]->models());
  if (symbols_) symbols_->planes[plane] = symbols;
}

PredictiveEncoder::Alpha PredictiveEncoder::alpha_levels(
    const Prediction& prediction, std::span<const std::uint32_t> rgba) const {
  const auto pixel_of = picture_.pixel_of();
  const std::size_t pixels = picture_.pixels();
  std::vector<std::uint8_t> predicted(pixels), expected(pixels), levels(pixels), off(pixels / 32);
  Alpha made;
  for (std::size_t s = 0; s < rgba.size(); ++s) {
    predicted[pixel_of[s]] = prediction.alpha[s];
    const std::uint8_t level = alpha_level(static_cast<std::uint8_t>(rgba[s] >> 24));
    levels[pixel_of[s]] = level;
    made.decoded.push_back(kAlphaValues[level]);
  }
  find_expected(predicted, expected);
  code_alpha(made.symbols,
             {picture_.width(), picture_.height(), coded_, predicted, expected, levels, off});
  std::tie(made.set, made.bits) = best_set(made.symbols, level_.models->alpha);
  return made;
}

PredictiveEncoder::Alpha PredictiveEncoder::soft_alpha(const Prediction& prediction,
                                                       std::span<const std::uint32_t> rgba) {
  const auto pixel_of = picture_.pixel_of();
  std::vector<float> weight(picture_.pixels()), difference(picture_.pixels());
  for (std::size_t s = 0; s < rgba.size(); ++s) {
    weight[pixel_of[s]] = coded_[pixel_of[s]] != 0 ? 1.f : 0.f;
    difference[pixel_of[s]] =
        static_cast<float>(rgba[s] >> 24) - static_cast<float>(prediction.alpha[s]);
  }
  const std::vector<std::uint8_t> all(states_.size(), 1);
  BlockPlane blocks = quantise(kAlphaPlane, all, weight, difference, kRoundUpFrom);
  Alpha made;
  made.symbols = list_plane(all, blocks);
  made.set = level_.models->alpha_sets;
  made.bits = best_set(made.symbols, level_.models->blocks).second;
  std::vector<std::int16_t> pixels(picture_.pixels());
  const auto steps = level_.steps_of(kAlphaPlane, scale_);
  for (std::size_t b = 0; b < blocks.size(); ++b)
    if (states_[b].length > 0) restore(blocks[b], states_[b].length, steps, picture_, b, pixels);
  for (std::size_t s = 0; s < rgba.size(); ++s)
    made.decoded.push_back(snapped(prediction.alpha[s] + pixels[pixel_of[s]]));
  return made;
}

void PredictiveEncoder::encode(const Prediction& prediction, std::span<const std::uint8_t> depth,
                               std::span<const std::uint32_t> rgba) {
  // Squared error plus bits, weighted.
  const auto cost = [&](const Alpha& alpha) {
    double error = 0;
    for (std::size_t s = 0; s < rgba.size(); ++s) {
      if (coded_[picture_.pixel_of()[s]] == 0) continue;
      const double off = static_cast<double>(alpha.decoded[s]) - static_cast<double>(rgba[s] >> 24);
      error += off * off;
    }
    const double step =
        level_.steps_of(kAlphaPlane, scale_)[0] / static_cast<double>(kCoefficientScale);
    return error + kAlphaErrorPerBit * step * step * alpha.bits;
  };
  Alpha alpha = soft_alpha(prediction, rgba);
  const bool soft = [&] {
    Alpha levels = alpha_levels(prediction, rgba);
    if (cost(alpha) < cost(levels)) return true;
    alpha = std::move(levels);
    return false;
  }();
  coder_.symbol(level_.level_models().alpha_set[0], static_cast<std::uint32_t>(alpha.set));
  if (soft) {
    encode_plane(kAlphaPlane, alpha.symbols);
  } else {
    states_.assign(states_.size(), {});
    coder_.list(alpha.symbols, level_.models->alpha[alpha.set]->models());
    if (symbols_) symbols_->alpha = alpha.symbols;
  }

  std::vector<std::uint8_t> pixels(picture_.pixels()), visible(states_.size());
  for (std::size_t s = 0; s < rgba.size(); ++s) pixels[picture_.pixel_of()[s]] = alpha.decoded[s];
  find_visible(picture_, pixels, coded_, visible);
  encode_depth(prediction, alpha.decoded, soft, visible, rgba, depth);
  encode_color(prediction, alpha.decoded, visible, rgba);
  coder_.finish();
}

void PredictiveEncoder::encode_depth(const Prediction& prediction,
                                     std::span<const std::uint8_t> alpha, bool soft,
                                     std::span<const std::uint8_t> visible,
                                     std::span<const std::uint32_t> rgba,
                                     std::span<const std::uint8_t> depth) {
  const auto pixel_of = picture_.pixel_of();
  std::vector<float> weight(picture_.pixels()), difference(picture_.pixels());
  for (std::size_t s = 0; s < alpha.size(); ++s) {
    const bool counts = coded_[pixel_of[s]] != 0 && alpha[s] > 0 && rgba[s] >> 24 > 0;
    weight[pixel_of[s]] = counts ? 1.f : 0.f;
    difference[pixel_of[s]] =
        static_cast<float>(depth[s]) - static_cast<float>(prediction.depth[s]);
  }
  BlockPlane blocks = quantise(kDepthPlane, visible, weight, difference,
                               soft ? kRoundSoftDepthUpFrom : kRoundUpFrom);
  encode_plane(kDepthPlane, list_plane(visible, blocks));
}

void PredictiveEncoder::encode_color(const Prediction& prediction,
                                     std::span<const std::uint8_t> alpha,
                                     std::span<const std::uint8_t> visible,
                                     std::span<const std::uint32_t> rgba) {
  const auto pixel_of = picture_.pixel_of();
  std::vector<float> weight(picture_.pixels());
  std::array<std::vector<float>, 3> difference;
  for (auto& plane : difference) plane.resize(picture_.pixels());
  const std::array<float, 9> planes = inverse(level_.matrix);
  for (std::size_t s = 0; s < alpha.size(); ++s) {
    if (alpha[s] == 0 || coded_[pixel_of[s]] == 0) continue;
    std::array<std::int32_t, 3> rgb;
    for (std::uint32_t c = 0; c < 3; ++c)
      rgb[c] = static_cast<std::int32_t>(rgba[s] >> 8 * c & 255) -
               static_cast<std::int32_t>(
                   premultiplied(prediction.color[s] >> 8 * c & 255, std::uint32_t{alpha[s]}));
    if (symbols_)
      for (std::size_t a = 0, k = 0; a < 3; ++a)
        for (std::size_t b = a; b < 3; ++b) symbols_->colors[k++] += rgb[a] * rgb[b];
    // Detail in hardly visible matter is mostly noise, which views do not reproduce.
    weight[pixel_of[s]] = std::sqrt(static_cast<float>(alpha[s]) / 255.f);
    for (std::size_t c = 0; c < 3; ++c)
      difference[c][pixel_of[s]] = planes[3 * c] * static_cast<float>(rgb[0]) +
                                   planes[3 * c + 1] * static_cast<float>(rgb[1]) +
                                   planes[3 * c + 2] * static_cast<float>(rgb[2]);
  }
  for (std::size_t c = 0; c < 3; ++c) {
    BlockPlane blocks = quantise(kYPlane + c, visible, weight, difference[c], kRoundUpFrom);
    encode_plane(kYPlane + c, list_plane(visible, blocks));
  }
}

/// The working memory of a thread.
struct PredictiveDecoder::Work {
  explicit Work(const TilePicture& picture) {
    const std::size_t pixels = picture.pixels(), blocks = pixels / 64;
    auto& keep = kept();
    predicted = keep.predicted.take(pixels), expected = keep.expected.take(pixels);
    levels = keep.levels.take(pixels), off = keep.off.take(pixels / 32);
    visible = keep.visible.take(blocks), alpha = keep.alpha.take(picture.samples());
    states = keep.states[0].take(blocks), states_before = keep.states[1].take(blocks);
    difference = keep.difference.take(pixels);
    for (std::size_t c = 0; c < 3; ++c) colors[c] = keep.colors[c].take(picture.samples());
    std::fill(states.begin(), states.end(), BlockState());
  }

  std::span<std::uint8_t> predicted, expected, levels, off, visible, alpha;
  std::span<BlockState> states, states_before;  // of the plane coded last, and before it
  std::span<std::int16_t> difference;           // of each pixel
  std::array<std::span<std::int16_t>, 3> colors;

 private:
  struct Kept {
    Scratch<std::uint8_t> predicted, expected, levels, off, visible, alpha;
    Scratch<BlockState> states[2];
    Scratch<std::int16_t> difference, colors[3];
  };
  static Kept& kept() {
    return per_thread<Kept>([] {});
  }
};

PredictiveDecoder::PredictiveDecoder(const PredictiveLevel& level, int scale,
                                     const TilePicture& picture, ByteSpan payload)
    : level_(level), scale_(scale), picture_(picture), coder_(payload), coded_(picture.covered()) {}

void PredictiveDecoder::references(std::span<const std::uint8_t> kinds,
                                   std::span<std::uint8_t> used) {
  code_references(coder_, level_.level_models().used, kinds, used);
}

void PredictiveDecoder::keep(KeptRays& rays) {
  rays.code(coder_);
  coded_ = rays.others(picture_);
}

/// Sets work.difference, unless it is 0 everywhere.
bool PredictiveDecoder::decode_plane(std::size_t plane, std::span<const std::uint8_t> coded,
                                     Work& work) {
  std::swap(work.states, work.states_before);
  const std::size_t set = coder_.symbol(level_.level_models().block_set[plane]);
  if (set == level_.models->block_sets) {
    std::fill(work.states.begin(), work.states.end(), BlockState());
    return false;
  }
  std::fill(work.difference.begin(), work.difference.end(), std::int16_t{0});
  const std::array<std::int32_t, 64> steps = level_.steps_of(plane, scale_);
  const std::size_t across = picture_.width() / 8;
  SymbolDecoder decoder(coder_, level_.models->blocks[set]->models().data());
  for (std::size_t b = 0; b < work.states.size(); ++b) {
    if (!coded[b]) {
      work.states[b] = {};
      continue;
    }
    Block block{};
    const Around around(work.states, across, b);
    code_block(decoder, around.left, around.above, work.states_before[b], work.states[b], block);
    if (const std::size_t length = work.states[b].length; length > 0)
      restore(block, length, steps, picture_, b, work.difference);
  }
  return true;
}

void PredictiveDecoder::decode_levels(std::size_t set, const Prediction& prediction, Work& work) {
  const auto pixel_of = picture_.pixel_of();
  std::fill(work.predicted.begin(), work.predicted.end(), std::uint8_t{0});
  for (std::size_t s = 0; s < prediction.alpha.size(); ++s)
    work.predicted[pixel_of[s]] = prediction.alpha[s];
  find_expected(work.predicted, work.expected);
  std::copy(work.expected.begin(), work.expected.end(), work.levels.begin());
  SymbolDecoder decoder(coder_, level_.models->alpha[set]->models().data());
  code_alpha(decoder, {picture_.width(), picture_.height(), coded_, work.predicted, work.expected,
                       work.levels, work.off});
  for (std::size_t s = 0; s < work.alpha.size(); ++s)
    work.alpha[s] = kAlphaValues[work.levels[pixel_of[s]]];
}

void PredictiveDecoder::decode_soft_alpha(const Prediction& prediction, Work& work) {
  const auto pixel_of = picture_.pixel_of();
  std::fill(work.visible.begin(), work.visible.end(), std::uint8_t{1});
  const bool differs = decode_plane(kAlphaPlane, work.visible, work);
  std::fill(work.levels.begin(), work.levels.end(), std::uint8_t{0});
  for (std::size_t s = 0; s < work.alpha.size(); ++s) {
    work.alpha[s] = snapped(prediction.alpha[s] + (differs ? work.difference[pixel_of[s]] : 0));
    work.levels[pixel_of[s]] = work.alpha[s];
  }
}

Result<void> PredictiveDecoder::decode(const Prediction& prediction, std::span<std::uint8_t> depth,
                                       std::span<std::uint32_t> rgba) {
  Work work(picture_);
  const auto pixel_of = picture_.pixel_of();
  const std::size_t set = coder_.symbol(level_.level_models().alpha_set[0]);
  if (set < level_.models->alpha_sets)
    decode_levels(set, prediction, work);
  else
    decode_soft_alpha(prediction, work);
  find_visible(picture_, work.levels, coded_, work.visible);

  const bool deeper = decode_plane(kDepthPlane, work.visible, work);
  for (std::size_t s = 0; s < depth.size(); ++s) {
    const int value = prediction.depth[s] + (deeper ? work.difference[pixel_of[s]] : 0);
    depth[s] = static_cast<std::uint8_t>(work.alpha[s] == 0 ? 0 : std::clamp(value, 0, 255));
  }
  for (std::size_t c = 0; c < 3; ++c)
    if (decode_plane(kYPlane + c, work.visible, work))
      for (std::size_t s = 0; s < rgba.size(); ++s)
        work.colors[c][s] = work.difference[pixel_of[s]];
    else
      std::fill(work.colors[c].begin(), work.colors[c].end(), std::int16_t{0});
  std::copy(prediction.color.begin(), prediction.color.end(), rgba.begin());
  premultiply(rgba, work.alpha);
  add_differences({work.colors[0], work.colors[1], work.colors[2]}, level_.matrix, rgba);
  if (coder_.finished()) return {};
  return fail(ErrorCode::bad_file, "the payload does not end where its content does");
}

}  // namespace slf::codec
