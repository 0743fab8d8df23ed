#include "codec/dct.h"

#include <algorithm>

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
using V = hn::Vec<D>;

/// One dimension of the inverse for all eight columns: to[y][x] = (sum over k of basis[k][y] *
/// from[k][x] + half) >> shift. Even and odd k are summed separately: the basis is symmetric.
template <int kShift>
HWY_INLINE void inverse_columns(const std::int32_t (*from)[8], std::int32_t (*to)[8]) {
  constexpr std::int32_t kOdd[4][4] = {
      {89, 75, 50, 18}, {75, -18, -89, -50}, {50, -89, 18, 75}, {18, -50, 75, -89}};
  const D d;
  const auto times = [&](V v, std::int32_t by) { return hn::Mul(v, hn::Set(d, by)); };
  const V half = hn::Set(d, 1 << (kShift - 1));
  for (std::size_t x = 0; x < 8; x += hn::Lanes(d)) {
    V c[8];
    for (std::size_t k = 0; k < 8; ++k) c[k] = hn::Load(d, &from[k][x]);
    const V a = hn::Add(hn::ShiftLeft<6>(hn::Add(c[0], c[4])), half);
    const V b = hn::Add(hn::ShiftLeft<6>(hn::Sub(c[0], c[4])), half);
    const V e = hn::Add(times(c[2], 83), times(c[6], 36));
    const V f = hn::Sub(times(c[2], 36), times(c[6], 83));
    const V even[4] = {hn::Add(a, e), hn::Add(b, f), hn::Sub(b, f), hn::Sub(a, e)};
    for (std::size_t y = 0; y < 4; ++y) {
      V odd = times(c[1], kOdd[0][y]);
      for (std::size_t k = 1; k < 4; ++k) odd = hn::Add(odd, times(c[2 * k + 1], kOdd[k][y]));
      hn::Store(hn::ShiftRight<kShift>(hn::Add(even[y], odd)), d, &to[y][x]);
      hn::Store(hn::ShiftRight<kShift>(hn::Sub(even[y], odd)), d, &to[7 - y][x]);
    }
  }
}

void inverse_dct_any(const Block& coefficients, std::int16_t* pixels, std::size_t stride) {
  HWY_ALIGN std::int32_t a[8][8], b[8][8];
  for (std::size_t k = 0; k < 64; ++k) a[k / 8][k % 8] = coefficients[k];
  inverse_columns<7>(a, b);
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x)  // transpose, and clamp to 16 bits as H.265 does
      a[x][y] = std::clamp(b[y][x], -32768, 32767);
  inverse_columns<12>(a, b);
  for (std::size_t y = 0; y < 8; ++y)
    for (std::size_t x = 0; x < 8; ++x) pixels[y * stride + x] = static_cast<std::int16_t>(b[x][y]);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf::codec
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf::codec {
namespace {

/// Basis functions, 181.02 times as large as orthonormal ones: kBasis[frequency][place].
constexpr int kBasis[8][8] = {
    {64, 64, 64, 64, 64, 64, 64, 64},     {89, 75, 50, 18, -18, -50, -75, -89},
    {83, 36, -36, -83, -83, -36, 36, 83}, {75, -18, -89, -50, 50, 89, 18, -75},
    {64, -64, -64, 64, 64, -64, -64, 64}, {50, -89, 18, 75, -75, -18, 89, -50},
    {36, -83, 83, -36, -36, 83, -83, 36}, {18, -50, 75, -89, 89, -75, 50, -18}};

}  // namespace

HWY_EXPORT(inverse_dct_any);

std::array<float, 64> forward_dct(const std::array<float, 64>& values) {
  // The transpose of the basis, normalised: coefficient = 16 * B v B^T / 181.02^2.
  constexpr float kNorm = static_cast<float>(kCoefficientScale) / 32768.f;
  std::array<float, 64> rows{}, out{};
  for (std::size_t y = 0; y < 8; ++y)
    for (std::size_t k = 0; k < 8; ++k) {
      float sum = 0;
      for (std::size_t x = 0; x < 8; ++x)
        sum += static_cast<float>(kBasis[k][x]) * values[8 * y + x];
      rows[8 * y + k] = sum;
    }
  for (std::size_t v = 0; v < 8; ++v)
    for (std::size_t k = 0; k < 8; ++k) {
      float sum = 0;
      for (std::size_t y = 0; y < 8; ++y) sum += static_cast<float>(kBasis[v][y]) * rows[8 * y + k];
      out[8 * v + k] = sum * kNorm;
    }
  return out;
}

void inverse_dct(const Block& coefficients, std::int16_t* pixels, std::size_t stride) {
  HWY_DYNAMIC_DISPATCH(inverse_dct_any)(coefficients, pixels, stride);
}

}  // namespace slf::codec
#endif  // HWY_ONCE
