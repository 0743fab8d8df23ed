// The syntax of alpha in few levels, coded against a prediction (FORMAT.md, "Levels of alpha"). One
// template serves encoder and decoder: Coder is RangeEncoder or RangeDecoder.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <span>
#include <vector>

#include "codec/range_coder.h"

namespace slf::codec {

/// The level that means opaque. Views of opaque fields are as good with 7 as with 15 or 255.
inline constexpr int kAlphaTop = 7;

/// alpha × kAlphaTop / 255, rounded.
[[nodiscard]] constexpr std::uint8_t alpha_level(std::uint8_t alpha) {
  const auto x = static_cast<std::uint16_t>(alpha * kAlphaTop + 128);
  return static_cast<std::uint8_t>(static_cast<std::uint16_t>(x + (x >> 8)) >> 8);
}
/// The alpha of each level.
inline constexpr std::array<std::uint8_t, kAlphaTop + 1> kAlphaValues = [] {
  std::array<std::uint8_t, kAlphaTop + 1> values{};
  for (std::size_t k = 0; k <= kAlphaTop; ++k)
    values[k] = static_cast<std::uint8_t>(k * 255 / kAlphaTop);
  return values;
}();

struct AlphaModels {
  BitModel as_predicted[2][2][2][2];
  BitModel clear[6][27], opaque[6][27];
  BitModel equal[3], below[3], further[3][kAlphaTop];
};

/// A picture in which only some pixels hold a sample.
struct AlphaPicture {
  std::size_t width = 0, height = 0;         ///< width is a multiple of 8
  std::span<const std::uint8_t> holds;       ///< 0 where a pixel holds no sample
  std::span<const std::uint8_t> prediction;  ///< 0..255
  std::span<std::uint8_t> levels;            ///< 0..kAlphaTop; 0 where a pixel holds no sample
};

template <class Coder>
void code_alpha(Coder& shared_coder, AlphaModels& models, const AlphaPicture& picture) {
  const std::size_t width = picture.width;
  const auto kind = [](int level) { return level == 0 ? 0 : level == kAlphaTop ? 2 : 1; };
  std::vector<std::uint8_t> predicted(picture.prediction.size());
  for (std::size_t at = 0; at < predicted.size(); ++at) {
    const std::uint8_t level = alpha_level(picture.prediction[at]);
    predicted[at] = picture.holds[at] ? level : std::uint8_t{0};
  }
  const auto eight = [](const std::uint8_t* from) {
    std::uint64_t pixels = 0;
    std::memcpy(&pixels, from, 8);
    return pixels;
  };
  // For each column of 8-pixel runs: whether the run above was as predicted.
  std::vector<std::uint8_t> matched(width / 8, 1);
  InRegisters<Coder> coder(shared_coder);
  for (std::size_t y = 0; y < picture.height; ++y)
    for (std::size_t x0 = 0; x0 < width; x0 += 8) {
      const std::size_t begin = y * width + x0;
      std::uint8_t* const levels = &picture.levels[begin];
      if (eight(&picture.holds[begin]) == 0) continue;
      const std::uint64_t run = eight(&predicted[begin]);
      const bool flat = run == std::rotl(run, 8);
      const bool as_above = y > 0 && run == eight(levels - width);
      const bool left = x0 == 0 || matched[x0 / 8 - 1];
      BitModel& model = models.as_predicted[flat][as_above][left][matched[x0 / 8]];
      matched[x0 / 8] = coder.bit(model, run == eight(levels)) ? 1 : 0;
      if (matched[x0 / 8]) {
        std::memcpy(levels, &predicted[begin], 8);
        continue;
      }
      for (std::size_t at = begin; at < begin + 8; ++at) {
        if (!picture.holds[at]) continue;
        const int expected = predicted[at];
        const std::size_t x = at - y * width;
        const int n = y > 0 ? picture.levels[at - width] : expected;
        const int w = x > 0 ? picture.levels[at - 1] : n;
        const int e = y > 0 && x + 1 < width ? picture.levels[at - width + 1] : n;
        const std::uint8_t p = picture.prediction[at];
        const int likely = p == 0 ? 0 : p < 48 ? 1 : p < 128 ? 2 : p < 208 ? 3 : p < 255 ? 4 : 5;
        const int around = kind(w) + 3 * kind(n) + 9 * kind(e);
        const int level = picture.levels[at];
        int coded = 0;
        if (!coder.bit(models.clear[likely][around], level == 0)) {
          coded = kAlphaTop;
          if (!coder.bit(models.opaque[likely][around], level == kAlphaTop)) {
            // A soft edge: code the difference from an expected level.
            const int middle = std::clamp((2 * expected + w + n + 2) / 4, 1, kAlphaTop - 1);
            const int spread = std::abs(w - n) + std::abs(expected - w);
            const int c = spread < 2 ? 0 : spread < 6 ? 1 : 2;
            coded = middle;
            if (!coder.bit(models.equal[c], level == middle)) {
              const bool below = middle > 1 && (middle + 1 == kAlphaTop ||
                                                coder.bit(models.below[c], level < middle));
              const int max_distance = below ? middle - 1 : kAlphaTop - 1 - middle;
              const int distance = std::abs(level - middle);
              int d = 1;
              while (d < max_distance && coder.bit(models.further[c][d], d < distance)) ++d;
              coded = below ? middle - d : middle + d;
            }
          }
        }
        picture.levels[at] = static_cast<std::uint8_t>(coded);
      }
    }
}

}  // namespace slf::codec
