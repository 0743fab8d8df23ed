// The syntax of alpha in few levels, coded against a prediction (FORMAT.md, "Alpha"). One
// template serves encoder and decoder: Coder is SymbolList or SymbolDecoder.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <span>

#include "codec/block_coder.h"

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

/// The models of a set for levels of alpha: where each group begins.
struct AlphaModels {
  static constexpr std::array<ModelGroup, 3> kGroups = {{{16 * 2 * 3, 16}, {6 * 27, 3}, {18, 6}}};

  static constexpr std::size_t kOff = 0;
  static constexpr std::size_t kKind = kOff + kGroups[0].models;
  static constexpr std::size_t kSoft = kKind + kGroups[1].models;
  static constexpr std::size_t kCount = kSoft + kGroups[2].models;
};

/// A picture in which only some pixels hold a sample. Both sides are multiples of 8.
struct AlphaPicture {
  std::size_t width = 0, height = 0;
  std::span<const std::uint8_t> holds;       ///< 0 where a pixel holds no sample
  std::span<const std::uint8_t> prediction;  ///< 0..255
  std::span<const std::uint8_t> expected;    ///< its levels; 0 where a pixel holds no sample
  /// 0..kAlphaTop; 0 where a pixel holds no sample. A decoder's are at first those expected.
  std::span<std::uint8_t> levels;
  std::span<std::uint8_t> off;  ///< working memory: a byte for each 8 × 4 pixels
};

/// Codes one level, given those around it.
template <class Coder>
std::uint8_t code_level(Coder& coder, int prediction, int expected, int w, int n, int ne,
                        int level) {
  const auto kind = [](int of) { return of == 0 ? 0u : of == kAlphaTop ? 2u : 1u; };
  const auto likely =
      static_cast<std::size_t>((prediction > 0) + (prediction >= 48) + (prediction >= 128) +
                               (prediction >= 208) + (prediction == 255));
  const std::size_t around = kind(w) + 3 * kind(n) + 9 * kind(ne);
  const std::uint32_t coded = coder.symbol(AlphaModels::kKind + 27 * likely + around, kind(level));
  if (coded != 1) return coded == 0 ? 0 : kAlphaTop;
  const int middle = std::clamp((2 * expected + w + n + 2) / 4, 1, kAlphaTop - 1);
  const int spread = std::abs(w - n) + std::abs(expected - w);
  const int c = spread < 2 ? 0 : spread < 6 ? 1 : 2;
  const auto model = AlphaModels::kSoft + static_cast<std::size_t>(3 * (middle - 1) + c);
  return static_cast<std::uint8_t>(1 + coder.symbol(model, static_cast<std::uint32_t>(level - 1)));
}

/// First come symbols that tell which runs of 8 pixels are not as expected, four runs a symbol,
/// then the levels in these runs.
template <class Coder>
void code_alpha(Coder& coder, const AlphaPicture& picture) {
  const std::size_t width = picture.width, across = width / 8;
  const auto eight = [](const std::uint8_t* from) {
    std::uint64_t pixels = 0;
    std::memcpy(&pixels, from, 8);
    return pixels;
  };
  for (std::size_t y = 0; y < picture.height; y += 4)
    for (std::size_t x = 0; x < across; ++x) {
      std::uint8_t* const off = &picture.off[y / 4 * across + x];
      std::uint32_t uneven = 0, known = 0;
      std::uint64_t holds = 0;
      for (std::size_t k = 0; k < 4; ++k) {
        const std::size_t at = (y + k) * width + 8 * x;
        const std::uint64_t run = eight(&picture.expected[at]);
        uneven |= (run != std::rotl(run, 8) ? 1u : 0u) << k;
        if constexpr (Coder::kEncodes) known |= (run != eight(&picture.levels[at]) ? 1u : 0u) << k;
        holds |= eight(&picture.holds[at]);
      }
      if (holds == 0) {
        *off = 0;
        continue;
      }
      const std::uint32_t left = x > 0 && off[-1] != 0 ? 1 : 0;
      const std::uint32_t above = y > 0 ? *(off - across) : 0;
      const std::uint32_t near = above == 0 ? 0 : above < 8 ? 1 : 2;
      *off = static_cast<std::uint8_t>(
          coder.symbol(AlphaModels::kOff + 6 * uneven + 3 * left + near, known));
    }
  for (std::size_t y = 0; y < picture.height; ++y)
    for (std::size_t run = 0; run < across; ++run) {
      if ((picture.off[y / 4 * across + run] >> (y % 4) & 1) == 0) continue;
      for (std::size_t x = 8 * run; x < 8 * run + 8; ++x) {
        const std::size_t at = y * width + x;
        if (!picture.holds[at]) continue;
        std::uint8_t* const level = &picture.levels[at];
        const int expected = picture.expected[at];
        const int n = y > 0 ? *(level - width) : expected;
        const int w = x > 0 ? level[-1] : n;
        const int ne = y > 0 && x + 1 < width ? *(level - width + 1) : n;
        *level = code_level(coder, picture.prediction[at], expected, w, n, ne, *level);
      }
    }
}

}  // namespace slf::codec
