// The syntax of quantised 8 × 8 blocks (FORMAT.md, "Blocks"). One template serves encoder and
// decoder: Coder is SymbolList or SymbolDecoder.
//
// Four coefficients that follow each other in zigzag order are a group. One symbol tells of each
// whether it is 0, 1 or more; larger magnitudes and signs follow.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstdlib>

#include "codec/dct.h"
#include "codec/zigzag.h"

namespace slf::codec {

/// Consecutive models of equally many symbols.
struct ModelGroup {
  std::size_t models, symbols;
};

/// The models of a set for planes of blocks: where each group begins.
struct BlockModels {
  static constexpr std::array<ModelGroup, 5> kGroups = {
      {{11 * 3, 17}, {5 * 3, 81}, {4 * 6, 81}, {4 * 3, 19}, {9, 2}}};

  static constexpr std::size_t kLength = 0;
  static constexpr std::size_t kLast = kLength + kGroups[0].models;
  static constexpr std::size_t kGroup = kLast + kGroups[1].models;
  static constexpr std::size_t kMagnitude = kGroup + kGroups[2].models;
  static constexpr std::size_t kMeanSign = kMagnitude + kGroups[3].models;
  static constexpr std::size_t kCount = kMeanSign + kGroups[4].models;
};

/// The largest quantised magnitude that can be coded.
inline constexpr float kMaxCoefficient = 16383;

/// What the blocks to the right of a coded block, below it and in the next plane depend on.
struct BlockState {
  std::array<std::uint8_t, 16> sums{};  ///< per group: the sum of min(magnitude, 2)
  std::uint8_t length = 0;              ///< groups up to the last one that is not 0
  std::uint8_t rank = 0;                ///< a class of lengths
  std::uint8_t mean_sign = 0;           ///< of the mean: 0, or 1 if it is positive, 2 if negative
};

/// The symbol of a group: min(magnitude, 2) of its coefficients as digits to base 3, the first one
/// being the lowest.
struct GroupSymbol {
  std::uint8_t sum = 0;             ///< of the digits
  std::uint8_t some = 0, many = 0;  ///< bit k: digit k is not 0; is 2
};
inline constexpr std::array<GroupSymbol, 81> kGroupSymbols = [] {
  std::array<GroupSymbol, 81> symbols{};
  for (std::size_t symbol = 0; symbol < 81; ++symbol)
    for (std::size_t k = 0, rest = symbol; k < 4; ++k, rest /= 3) {
      const std::size_t digit = rest % 3;
      GroupSymbol& of = symbols[symbol];
      of.sum = static_cast<std::uint8_t>(of.sum + digit);
      if (digit > 0) of.some = static_cast<std::uint8_t>(of.some | 1 << k);
      if (digit > 1) of.many = static_cast<std::uint8_t>(of.many | 1 << k);
    }
  return symbols;
}();

/// The symbol of the group whose coefficients begin at zigzag[first].
[[nodiscard]] inline std::uint32_t group_symbol(const Block& block, std::size_t first) {
  std::uint32_t symbol = 0;
  for (std::size_t k = 4; k-- > 0;)
    symbol =
        3 * symbol + static_cast<std::uint32_t>(std::min(2, std::abs(block[kZigzag[first + k]])));
  return symbol;
}

/// Codes a magnitude above 1: its excess over 2 itself if it is below 8, else the number of its
/// binary digits, and all digits but the first.
template <class Coder>
std::uint32_t code_magnitude(Coder& coder, std::size_t model, std::uint32_t magnitude) {
  const std::uint32_t known = Coder::kEncodes ? magnitude - 2 : 0;
  const auto digits = static_cast<std::uint32_t>(std::bit_width(known));
  const std::uint32_t symbol = coder.symbol(model, known < 8 ? known : 4 + digits);
  if (symbol < 8) return 2 + symbol;
  const auto rest = static_cast<int>(symbol - 5);
  return 2 + (1u << rest) + coder.bits(rest, known & ((1u << rest) - 1));
}

/// Classes of twice the sum of the group before plus those of the groups beside.
inline constexpr std::array<std::uint8_t, 33> kActivityOf = [] {
  std::array<std::uint8_t, 33> classes{};
  for (std::size_t k = 0; k < classes.size(); ++k)
    classes[k] = k == 0 ? 0 : k < 3 ? 1 : k < 5 ? 2 : k < 8 ? 3 : k < 12 ? 4 : 5;
  return classes;
}();

/// Codes a block and sets its state. `left` and `above` are the states of those blocks, and
/// `before` that of the same block in the plane that was coded before. A decoder's block must be 0.
template <class Coder>
void code_block(Coder& coder, const BlockState& left, const BlockState& above,
                const BlockState& before, BlockState& state, Block& block) {
  using M = BlockModels;
  state = {};
  std::uint32_t length = 0;
  if constexpr (Coder::kEncodes)
    for (std::uint32_t g = 0; g < 16; ++g)
      if (group_symbol(block, 4 * g) != 0) length = g + 1;
  const std::size_t around = std::size_t{left.rank} + above.rank;
  length = coder.symbol(M::kLength + 3 * around + std::min<std::size_t>(before.length, 2), length);
  if (length == 0) return;
  state.length = static_cast<std::uint8_t>(length);

  std::uint32_t symbol = 0, last_sum = 0;
  for (std::uint32_t g = length; g-- > 0;) {
    const std::uint32_t beside = std::uint32_t{left.sums[g]} + above.sums[g];
    const std::uint32_t activity = 2 * last_sum + beside;
    const std::size_t model = g + 1 == length
                                  ? M::kLast +
                                        3 * (g < 3   ? g
                                             : g < 5 ? 3
                                                     : 4) +
                                        (beside == 0  ? 0
                                         : beside < 3 ? 1
                                                      : 2)
                                  : M::kGroup + 6 * std::min(g, 3u) + kActivityOf[activity];
    symbol = coder.symbol(model, Coder::kEncodes ? group_symbol(block, 4 * g) : 0);
    const GroupSymbol& group = kGroupSymbols[symbol];
    const std::uint32_t busy = activity < 3 ? 0 : activity < 8 ? 1 : 2;
    state.sums[g] = group.sum;
    last_sum = group.sum;

    std::array<std::uint32_t, 4> magnitudes{1, 1, 1, 1};
    for (unsigned many = group.many; many != 0; many &= many - 1) {
      const auto k = static_cast<std::uint32_t>(std::countr_zero(many));
      const std::uint32_t place = g == 0 ? std::min(k, 1u) : g == 1 ? 2 : 3;
      const std::int32_t known = Coder::kEncodes ? std::abs(block[kZigzag[4 * g + k]]) : 0;
      magnitudes[k] = code_magnitude(coder, M::kMagnitude + 3 * place + busy,
                                     static_cast<std::uint32_t>(known));
    }

    // The sign of the mean has a model; other signs are as likely + as -.
    unsigned signed_ones = group.some;
    std::uint32_t negative = 0;
    if constexpr (Coder::kEncodes)
      for (unsigned k = 0, n = 0; k < 4; ++k)
        if (const int value = block[kZigzag[4 * g + k]]; value != 0 && (g > 0 || k > 0))
          negative |= (value < 0 ? 1u : 0u) << n++;
    if (g == 0 && (group.some & 1) != 0) {
      const std::uint32_t minus =
          coder.symbol(M::kMeanSign + 3u * left.mean_sign + above.mean_sign, block[0] < 0 ? 1 : 0);
      state.mean_sign = static_cast<std::uint8_t>(1 + minus);
      signed_ones &= ~1u;
      const auto value = static_cast<std::int32_t>(magnitudes[0]);
      block[0] = static_cast<std::int16_t>(minus != 0 ? -value : value);
    }
    if (signed_ones == 0) continue;
    negative = coder.bits(std::popcount(signed_ones), negative);
    for (; signed_ones != 0; signed_ones &= signed_ones - 1, negative >>= 1) {
      const auto k = static_cast<std::uint32_t>(std::countr_zero(signed_ones));
      const auto value = static_cast<std::int32_t>(magnitudes[k]);
      block[kZigzag[4 * g + k]] = static_cast<std::int16_t>((negative & 1) != 0 ? -value : value);
    }
  }
  const bool only_mean = (kGroupSymbols[symbol].some & ~1u) == 0;
  state.rank = static_cast<std::uint8_t>(length == 1   ? (only_mean ? 1 : 2)
                                         : length == 2 ? 3
                                         : length < 5  ? 4
                                                       : 5);
}

}  // namespace slf::codec
