// The syntax of residuals that are coded one by one (FORMAT.md, "Channels"). One template serves
// encoder and decoder: Coder is RangeEncoder or RangeDecoder.
#pragma once

#include <cstdint>
#include <cstdlib>

#include "codec/range_coder.h"

namespace slf::codec {

/// The models of the residuals of one channel. All start at one half; a tile has enough samples to
/// adapt them.
struct ResidualModels {
  static constexpr std::size_t kActivities = 20;  ///< classes of the residuals around a sample
  static constexpr std::size_t kFlat = 16;        ///< flat alpha: classes of predictions around
  static constexpr std::size_t kContexts = kActivities + kFlat;
  static constexpr std::size_t kSizes = 17;

  BitModel nonzero[kContexts];
  BitModel size[kContexts][kSizes];  ///< whether there are more binary digits than index + 1
  BitModel second[kSizes];           ///< the second digit
  BitModel third[kSizes][2];
};

/// Codes a residual within ±131071 in one of the contexts.
template <class Coder>
std::int32_t code_residual(Coder& coder, ResidualModels& models, std::size_t context,
                           std::int32_t residual) {
  const auto known = static_cast<std::uint32_t>(std::abs(residual));
  if (!coder.bit(models.nonzero[context], known != 0)) return 0;
  const bool negative = coder.even_bit(residual < 0);
  std::uint32_t more = 0;  // digits after the first
  while (more + 1 < ResidualModels::kSizes &&
         coder.bit(models.size[context][more], known >> (more + 1) != 0))
    ++more;
  std::uint32_t magnitude = 1;
  for (std::uint32_t digit = more; digit-- > 0;) {
    const bool one = (known >> digit & 1) != 0;
    const std::uint32_t done = more - 1 - digit;
    const bool coded = done == 0   ? coder.bit(models.second[more], one)
                       : done == 1 ? coder.bit(models.third[more][magnitude & 1], one)
                                   : coder.even_bit(one);
    magnitude = magnitude << 1 | (coded ? 1u : 0u);
  }
  return negative ? -static_cast<std::int32_t>(magnitude) : static_cast<std::int32_t>(magnitude);
}

}  // namespace slf::codec
