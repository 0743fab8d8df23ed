#include "codec/premultiply.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "codec/premultiply.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace slf::codec {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// Multiplies as many pixels as `d` has lanes, two channels at a time, each in 16 bits.
template <class D>
HWY_INLINE void multiply(D d, std::uint32_t* pixels, const std::uint8_t* alpha) {
  const hn::Rebind<std::uint8_t, D> narrow;
  const auto low = hn::Set(d, 0x00FF00FF), half = hn::Set(d, 0x00800080);
  const auto a = hn::PromoteTo(d, hn::LoadU(narrow, alpha));
  const auto scaled = [&](auto two) {
    const auto product = hn::Add(hn::Mul(two, a), half);
    return hn::Add(product, hn::And(hn::ShiftRight<8>(product), low));
  };
  const auto pixel = hn::LoadU(d, pixels);
  const auto red_blue = hn::And(hn::ShiftRight<8>(scaled(hn::And(pixel, low))), low);
  const auto green_alpha = hn::AndNot(low, scaled(hn::And(hn::ShiftRight<8>(pixel), low)));
  hn::StoreU(hn::Or(red_blue, green_alpha), d, pixels);
}

void premultiply_any(std::uint32_t* pixels, const std::uint8_t* alpha, std::size_t count) {
  const hn::ScalableTag<std::uint32_t> d;
  std::size_t k = 0;
  for (; k + hn::Lanes(d) <= count; k += hn::Lanes(d)) multiply(d, pixels + k, alpha + k);
  for (; k < count; ++k) multiply(hn::CappedTag<std::uint32_t, 1>(), pixels + k, alpha + k);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf::codec
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf::codec {

HWY_EXPORT(premultiply_any);

void premultiply(std::span<std::uint32_t> pixels, std::span<const std::uint8_t> alpha) {
  HWY_DYNAMIC_DISPATCH(premultiply_any)(pixels.data(), alpha.data(), alpha.size());
}

}  // namespace slf::codec
#endif  // HWY_ONCE
