// The syntax of quantised 8 × 8 blocks (FORMAT.md, "Coefficients"). One template serves encoder and
// decoder: Coder is RangeEncoder or RangeDecoder.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <iterator>
#include <vector>

#include "codec/dct.h"
#include "codec/range_coder.h"
#include "codec/zigzag.h"

namespace slf::codec {

/// The models of one kind of plane. The constants count their contexts.
struct BlockModels {
  static constexpr std::size_t kSizes = 7;       ///< classes of a block's count, if above 0
  static constexpr std::size_t kAround = 11;     ///< classes of the left and upper blocks' counts
  static constexpr std::size_t kDiagonals = 15;  ///< x + y of a coefficient
  static constexpr std::size_t kNear = 6;        ///< classes of magnitudes around a coefficient
  static constexpr std::size_t kAlike = 3;       ///< the same coefficient to the left and above
  static constexpr std::size_t kBands = 5;
  static constexpr std::size_t kPrefix = 14;

  BitModel size[kAround][kSizes];
  BitModel count[64];
  BitModel significant[kDiagonals][kNear][kAlike];
  BitModel above_one[kBands][kNear][kAlike];
  BitModel above_two[kBands][kNear];
  BitModel prefix[kPrefix];
  BitModel dc_sign[9];
};

/// The largest quantised magnitude that can be coded.
inline constexpr float kMaxCoefficient = 16383;

/// The quantised blocks of a plane, row by row. Blocks that are not coded are zero.
struct BlockPlane {
  std::size_t across = 0;  ///< blocks in a row
  std::vector<Block> blocks;
  std::vector<std::uint8_t> counts;  ///< per block: coefficients up to the last nonzero one
};

/// Codes `value` in [0, 2^bits) with a binary tree of 2^bits - 1 models.
template <class Coder>
std::uint32_t code_tree(Coder& coder, BitModel* models, int bits, std::uint32_t value) {
  std::uint32_t node = 1;
  for (int k = bits - 1; k >= 0; --k)
    node = node << 1 | (coder.bit(models[node - 1], (value >> k & 1) != 0) ? 1u : 0u);
  return node - (1u << bits);
}

/// Codes the count of a block's coefficients: a class k, then the position in it. Classes 0, 1 and
/// 2 are these counts; class k > 2 has the counts in (2^(k-2), 2^(k-1)].
template <class Coder>
std::uint32_t code_count(Coder& coder, BlockModels& models, std::size_t around,
                         std::uint32_t count) {
  std::uint32_t size = count < 3 ? count : 0;
  if (count >= 3)
    for (size = 3; count > 1u << (size - 1);) ++size;
  std::uint32_t k = 0;
  while (k < BlockModels::kSizes && coder.bit(models.size[around][k], k < size)) ++k;
  if (k < 3) return k;
  const int bits = static_cast<int>(k) - 2;
  const std::uint32_t first = (1u << bits) + 1;
  return first + code_tree(coder, models.count + (1u << bits) - 2, bits, count - first);
}

/// Codes the coefficients of a block, `count` of them, from high frequencies to low.
template <class Coder>
void code_coefficients(Coder& shared_coder, BlockModels& models, const Block& left,
                       const Block& above, std::uint32_t count, Block& block) {
  static constexpr std::uint8_t kNearOf[] = {0, 1, 2, 3, 3, 4, 4, 4, 4};  // then 5
  std::uint8_t size[10][10] = {};  // magnitudes, with a border of zeros
  InRegisters<Coder> coder(shared_coder);
  for (std::uint32_t k = count; k-- > 0;) {
    const std::size_t at = kZigzag[k], x = at % 8, y = at / 8;
    const unsigned sum =
        size[y][x + 1] + size[y + 1][x] + size[y + 1][x + 1] + size[y][x + 2] + size[y + 2][x];
    const std::size_t near = sum < std::size(kNearOf) ? kNearOf[sum] : 5;
    const std::size_t alike =
        static_cast<std::size_t>(std::min(2, std::abs(left[at]) + std::abs(above[at])));
    const std::size_t diagonal = x + y;
    const std::size_t band = diagonal < 3 ? diagonal : diagonal < 6 ? 3 : 4;
    const std::int32_t value = block[at];
    const std::uint32_t known = static_cast<std::uint32_t>(std::abs(value));
    if (k + 1 < count && !coder.bit(models.significant[diagonal][near][alike], known > 0)) continue;
    std::uint32_t magnitude = 1;
    if (coder.bit(models.above_one[band][near][alike], known > 1)) {
      magnitude = 2;
      if (coder.bit(models.above_two[band][near], known > 2)) {
        // Exponential Golomb: the number of bits of magnitude - 2, then all bits but the first.
        std::uint32_t bits = 0;
        const std::uint32_t rest = known - 2;
        while (bits + 1 < BlockModels::kPrefix &&
               coder.bit(models.prefix[bits], rest >> (bits + 1) != 0))
          ++bits;
        std::uint32_t coded = 1;
        for (std::uint32_t b = bits; b-- > 0;)
          coded = coded << 1 | (coder.even_bit((rest >> b & 1) != 0) ? 1u : 0u);
        magnitude = 2 + coded;
      }
    }
    bool negative = value < 0;
    if (at == 0) {
      const auto sign = [](std::int32_t v) -> std::size_t { return v == 0 ? 0 : v > 0 ? 1 : 2; };
      negative = coder.bit(models.dc_sign[3 * sign(left[0]) + sign(above[0])], negative);
    } else {
      negative = coder.even_bit(negative);
    }
    size[y][x] = static_cast<std::uint8_t>(std::min(magnitude, 15u));
    block[at] = static_cast<std::int16_t>(negative ? -static_cast<std::int32_t>(magnitude)
                                                   : static_cast<std::int32_t>(magnitude));
  }
}

/// Codes block `index` of a plane. REQUIRES: all blocks before it are coded.
template <class Coder>
void code_block(Coder& coder, BlockModels& models, BlockPlane& plane, std::size_t index) {
  static constexpr Block kNothing{};
  const bool has_left = index % plane.across != 0, has_above = index >= plane.across;
  const auto rank = [](std::uint32_t count) -> std::size_t {
    return count < 3 ? count : count < 9 ? 3 : count < 17 ? 4 : 5;
  };
  const std::size_t around = (has_left ? rank(plane.counts[index - 1]) : 0) +
                             (has_above ? rank(plane.counts[index - plane.across]) : 0);
  const std::uint32_t count = code_count(coder, models, around, plane.counts[index]);
  plane.counts[index] = static_cast<std::uint8_t>(count);
  if (count == 0) return;
  const Block& left = has_left ? plane.blocks[index - 1] : kNothing;
  const Block& above = has_above ? plane.blocks[index - plane.across] : kNothing;
  code_coefficients(coder, models, left, above, count, plane.blocks[index]);
}

}  // namespace slf::codec
