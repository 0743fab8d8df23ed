#include "codec/dct.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "codec/dct.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace slf::codec {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using D = hn::CappedTag<std::int32_t, 8>;
using D16 = hn::Rebind<std::int16_t, D>;
using V = hn::Vec<D>;

/// One dimension of the inverse for all eight columns: to[y][x] = (sum over k of basis[k][y] *
/// from(k, x) + half) >> shift, limited to 16 bits as H.265 does. Even and odd k are summed
/// separately: the basis is symmetric. From(k, x) is zero for k >= kCount, which is 4 or 8.
template <int kShift, std::size_t kCount, class From>
HWY_INLINE void inverse_columns(From from, std::int16_t (*to)[8]) {
  constexpr std::int32_t kOdd[4][4] = {
      {89, 75, 50, 18}, {75, -18, -89, -50}, {50, -89, 18, 75}, {18, -50, 75, -89}};
  const D d;
  const D16 narrow;
  const auto times = [&](V v, std::int32_t by) { return hn::Mul(v, hn::Set(d, by)); };
  const V half = hn::Set(d, 1 << (kShift - 1));
  for (std::size_t x = 0; x < 8; x += hn::Lanes(d)) {
    V c[8];
    for (std::size_t k = 0; k < kCount; ++k) c[k] = from(k, x);
    for (std::size_t k = kCount; k < 8; ++k) c[k] = hn::Zero(d);
    V a = hn::Add(hn::ShiftLeft<6>(c[0]), half), b = a;
    V e = times(c[2], 83), f = times(c[2], 36);
    if constexpr (kCount > 4) {
      a = hn::Add(a, hn::ShiftLeft<6>(c[4])), b = hn::Sub(b, hn::ShiftLeft<6>(c[4]));
      e = hn::Add(e, times(c[6], 36)), f = hn::Sub(f, times(c[6], 83));
    }
    const V even[4] = {hn::Add(a, e), hn::Add(b, f), hn::Sub(b, f), hn::Sub(a, e)};
    for (std::size_t y = 0; y < 4; ++y) {
      V odd = times(c[1], kOdd[0][y]);
      for (std::size_t k = 1; k < kCount / 2; ++k)
        odd = hn::Add(odd, times(c[2 * k + 1], kOdd[k][y]));
      const auto store = [&](V v, std::size_t at) {
        hn::Store(hn::DemoteTo(narrow, hn::ShiftRight<kShift>(v)), narrow, &to[at][x]);
      };
      store(hn::Add(even[y], odd), y);
      store(hn::Sub(even[y], odd), 7 - y);
    }
  }
}

/// Writes from[x][y] to to[y * stride + x].
HWY_INLINE void transpose(const std::int16_t (*from)[8], std::int16_t* to, std::size_t stride) {
#if HWY_TARGET == HWY_SCALAR
  for (std::size_t y = 0; y < 8; ++y)
    for (std::size_t x = 0; x < 8; ++x) to[y * stride + x] = from[x][y];
#else
  const hn::FixedTag<std::int16_t, 8> d;
  const hn::FixedTag<std::int32_t, 4> pairs;
  const hn::FixedTag<std::int64_t, 2> quads;
  // The pairs of rows 2k and 2k + 1: columns 0 to 3, and 4 to 7.
  const auto row = [&](std::size_t k) { return hn::Load(d, from[k]); };
  const auto lower = [&](std::size_t k) {
    return hn::BitCast(pairs, hn::InterleaveLower(d, row(2 * k), row(2 * k + 1)));
  };
  const auto upper = [&](std::size_t k) {
    return hn::BitCast(pairs, hn::InterleaveUpper(d, row(2 * k), row(2 * k + 1)));
  };
  const auto store = [&](std::size_t y, auto a, auto b) {  // rows y and y + 1, of four columns each
    const auto p = hn::BitCast(quads, a), q = hn::BitCast(quads, b);
    hn::StoreU(hn::BitCast(d, hn::InterleaveLower(quads, p, q)), d, to + y * stride);
    hn::StoreU(hn::BitCast(d, hn::InterleaveUpper(quads, p, q)), d, to + (y + 1) * stride);
  };
  const auto four = [&](std::size_t y, auto a, auto b, auto c, auto e) {
    store(y, hn::InterleaveLower(pairs, a, b), hn::InterleaveLower(pairs, c, e));
    store(y + 2, hn::InterleaveUpper(pairs, a, b), hn::InterleaveUpper(pairs, c, e));
  };
  four(0, lower(0), lower(1), lower(2), lower(3));
  four(4, upper(0), upper(1), upper(2), upper(3));
#endif
}

/// `from`(k, x) are coefficients: of the first kCount vertical and horizontal frequencies.
template <std::size_t kCount, class From>
HWY_INLINE void inverse(From from, std::int16_t* pixels, std::size_t stride) {
  HWY_ALIGN std::int16_t a[8][8], b[8][8];
  inverse_columns<7, kCount>(from, a);
  transpose(a, &b[0][0], 8);
  inverse_columns<12, kCount>(
      [&](std::size_t k, std::size_t x) { return hn::PromoteTo(D(), hn::Load(D16(), &b[k][x])); },
      a);
  transpose(a, pixels, stride);
}

void restore_block_any(const Block& quantised, std::size_t count, const std::int32_t* steps,
                       std::int16_t* pixels, std::size_t stride) {
  const auto coefficients = [&](std::size_t k, std::size_t x) {
    const D d;
    const V value = hn::PromoteTo(d, hn::LoadU(D16(), &quantised[8 * k + x]));
    const V product = hn::Mul(value, hn::LoadU(d, steps + 8 * k + x));
    return hn::Min(hn::Max(product, hn::Set(d, -32768)), hn::Set(d, 32767));
  };
  // The first ten in zigzag order are of the four lowest frequencies.
  if (count <= 10)
    inverse<4>(coefficients, pixels, stride);
  else
    inverse<8>(coefficients, pixels, stride);
}

void multiply_any(const float* a, std::size_t a_stride, const float* b, std::size_t b_stride,
                  float* product) {
  const hn::CappedTag<float, 8> d;
  for (std::size_t x = 0; x < 8; x += hn::Lanes(d))
    for (std::size_t y = 0; y < 8; ++y) {
      auto sum = hn::Mul(hn::Set(d, a[y * a_stride]), hn::LoadU(d, b + x));
      for (std::size_t k = 1; k < 8; ++k)
        sum = hn::Add(sum,
                      hn::Mul(hn::Set(d, a[y * a_stride + k]), hn::LoadU(d, b + k * b_stride + x)));
      hn::StoreU(sum, d, product + 8 * y + x);
    }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf::codec
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf::codec {
namespace {

/// Basis functions, 181.02 times as large as orthonormal ones: one in each row.
constexpr std::array<float, 64> kBasis = {
    64, 64,  64,  64,  64,  64,  64,  64, 89, 75,  50,  18,  -18, -50, -75, -89,
    83, 36,  -36, -83, -83, -36, 36,  83, 75, -18, -89, -50, 50,  89,  18,  -75,
    64, -64, -64, 64,  64,  -64, -64, 64, 50, -89, 18,  75,  -75, -18, 89,  -50,
    36, -83, 83,  -36, -36, 83,  -83, 36, 18, -50, 75,  -89, 89,  -75, 50,  -18};

/// The basis with one function in each column, normalised: coefficient = 16 * B v B^T / 181.02^2.
constexpr std::array<float, 64> kNormalised =
    transposed(kBasis, static_cast<float>(kCoefficientScale) / 32768.f);

}  // namespace

HWY_EXPORT(multiply_any);
HWY_EXPORT(restore_block_any);

void multiply(const float* a, std::size_t a_stride, const float* b, std::size_t b_stride,
              std::array<float, 64>& product) {
  HWY_DYNAMIC_DISPATCH(multiply_any)(a, a_stride, b, b_stride, product.data());
}

std::array<float, 64> forward_dct(const float* values, std::size_t stride) {
  std::array<float, 64> rows, out;
  multiply(values, stride, kNormalised.data(), 8, rows);
  multiply(kBasis.data(), 8, rows.data(), 8, out);
  return out;
}

void restore_block(const Block& quantised, std::size_t count,
                   const std::array<std::int32_t, 64>& steps, std::int16_t* pixels,
                   std::size_t stride) {
  HWY_DYNAMIC_DISPATCH(restore_block_any)(quantised, count, steps.data(), pixels, stride);
}

}  // namespace slf::codec
#endif  // HWY_ONCE
