#include "codec/color_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "codec/color_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace slf::codec {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// Calls use(d, k) for the pixels from `k` on, as many as `d` has lanes.
template <class Use>
HWY_INLINE void for_vectors(std::size_t count, Use use) {
  const hn::ScalableTag<std::uint32_t> d;
  std::size_t k = 0;
  for (; k + hn::Lanes(d) <= count; k += hn::Lanes(d)) use(d, k);
  for (; k < count; ++k) use(hn::CappedTag<std::uint32_t, 1>(), k);
}

/// Multiplies two channels at a time, each in 16 bits.
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
  for_vectors(count, [&](auto d, std::size_t k) { multiply(d, pixels + k, alpha + k); });
}

template <class D>
HWY_INLINE void add(D du, const std::int16_t* const difference[3], const std::int16_t* matrix,
                    std::size_t k, std::uint32_t* pixels) {
  const hn::RebindToSigned<D> d;
  const hn::Rebind<std::int16_t, D> narrow;
  const auto load = [&](std::size_t c) {
    return hn::PromoteTo(d, hn::LoadU(narrow, difference[c] + k));
  };
  const auto a = load(0), b = load(1), c = load(2);
  const auto before = hn::LoadU(du, pixels + k);
  const auto pixel = hn::BitCast(d, before);
  const auto limit = hn::BitCast(d, hn::ShiftRight<24>(before));
  // Halves round up, but those of G, in which YCbCr's terms are subtracted, down.
  const auto sum = [&](auto shifted, const std::int16_t* row, std::int32_t half) {
    const auto times = [&](auto v, std::size_t by) { return hn::Mul(v, hn::Set(d, row[by])); };
    const auto by =
        hn::Add(hn::Add(times(a, 0), times(b, 1)), hn::Add(times(c, 2), hn::Set(d, half)));
    const auto value = hn::Add(hn::And(shifted, hn::Set(d, 255)), hn::ShiftRight<8>(by));
    return hn::Min(hn::Max(value, hn::Zero(d)), limit);
  };
  const auto red = sum(pixel, matrix, 128);
  const auto green = sum(hn::ShiftRight<8>(pixel), matrix + 3, 127);
  const auto blue = sum(hn::ShiftRight<16>(pixel), matrix + 6, 128);
  const auto rgb = hn::Or3(red, hn::ShiftLeft<8>(green), hn::ShiftLeft<16>(blue));
  const auto top = hn::And(before, hn::Set(du, 0xFF000000u));
  hn::StoreU(hn::Or(hn::BitCast(du, rgb), top), du, pixels + k);
}

void add_differences_any(const std::int16_t* const difference[3], const std::int16_t* matrix,
                         std::size_t count, std::uint32_t* pixels) {
  for_vectors(count, [&](auto d, std::size_t k) { add(d, difference, matrix, k, pixels); });
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf::codec
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf::codec {

HWY_EXPORT(premultiply_any);
HWY_EXPORT(add_differences_any);

void premultiply(std::span<std::uint32_t> pixels, std::span<const std::uint8_t> alpha) {
  HWY_DYNAMIC_DISPATCH(premultiply_any)(pixels.data(), alpha.data(), alpha.size());
}

void add_differences(const std::array<std::span<const std::int16_t>, 3>& differences,
                     const ColorMatrix& matrix, std::span<std::uint32_t> pixels) {
  const std::int16_t* const difference[] = {differences[0].data(), differences[1].data(),
                                            differences[2].data()};
  HWY_DYNAMIC_DISPATCH(add_differences_any)
  (difference, matrix.data(), pixels.size(), pixels.data());
}

}  // namespace slf::codec
#endif  // HWY_ONCE
