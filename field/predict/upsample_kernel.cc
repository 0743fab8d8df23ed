#include "field/predict/upsample_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/predict/upsample_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// Two of these vectors are as long as kPadding.
using Bytes = hn::CappedTag<std::uint8_t, 32>;

/// Columns next to each other on a line.
struct Columns {
  hn::Vec<Bytes> alpha, depth;

  static HWY_INLINE Columns load(const std::uint8_t* alpha, const std::uint8_t* depth) {
    return {hn::LoadU(Bytes(), alpha), hn::LoadU(Bytes(), depth)};
  }
  HWY_INLINE Columns mean(const Columns& other) const {
    const auto zero = hn::Zero(Bytes());
    const auto visible =
        hn::IfThenElse(hn::Eq(alpha, zero), other.depth, hn::AverageRound(depth, other.depth));
    return {hn::AverageRound(alpha, other.alpha),
            hn::IfThenElse(hn::Eq(other.alpha, zero), depth, visible)};
  }
  /// Stores these columns and `odd` ones in turn.
  HWY_INLINE void store(const Columns& odd, std::uint8_t* to_alpha, std::uint8_t* to_depth) const {
    hn::StoreInterleaved2(alpha, odd.alpha, Bytes(), to_alpha);
    hn::StoreInterleaved2(depth, odd.depth, Bytes(), to_depth);
  }
};

void upsample_columns_any(std::uint32_t side, const std::uint8_t* even_alpha,
                          const std::uint8_t* even_depth, std::uint8_t* alpha,
                          std::uint8_t* depth) {
  // Lines overlap what vectors write beyond the end of the line before.
  for (std::uint32_t length = side / 2 + 1; length > 0; --length) {
    const std::uint32_t fine = 2 * length - 1;  // of this line; the next is one shorter
    for (std::uint32_t k = 0; k < length; k += hn::Lanes(Bytes())) {
      const Columns here = Columns::load(even_alpha + k, even_depth + k);
      const Columns right = Columns::load(even_alpha + k + 1, even_depth + k + 1);
      here.store(here.mean(right), alpha + 2 * k, depth + 2 * k);
    }
    alpha += fine, depth += fine;
    for (std::uint32_t k = 0; k + 1 < length; k += hn::Lanes(Bytes())) {
      const Columns above = Columns::load(even_alpha + k, even_depth + k);
      const Columns right = Columns::load(even_alpha + k + 1, even_depth + k + 1);
      const Columns below = Columns::load(even_alpha + length + k, even_depth + length + k);
      above.mean(below).store(right.mean(below), alpha + 2 * k, depth + 2 * k);
    }
    alpha += fine - 1, depth += fine - 1;
    even_alpha += length, even_depth += length;
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(upsample_columns_any);

void upsample_columns(std::uint32_t side, const std::uint8_t* even_alpha,
                      const std::uint8_t* even_depth, std::uint8_t* alpha, std::uint8_t* depth) {
  HWY_DYNAMIC_DISPATCH(upsample_columns_any)(side, even_alpha, even_depth, alpha, depth);
}

}  // namespace slf
#endif  // HWY_ONCE
