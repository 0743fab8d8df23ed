// Vectors of floats and integers, as wide as those of the instruction set. All kernels in field/
// include this.

// Included once per instruction set.
#if defined(SLF_FIELD_GEOMETRY_VECTORS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLF_FIELD_GEOMETRY_VECTORS_INL_H_
#undef SLF_FIELD_GEOMETRY_VECTORS_INL_H_
#else
#define SLF_FIELD_GEOMETRY_VECTORS_INL_H_
#endif

#include <hwy/highway.h>

#include <cstdint>

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<float>;
using DI = hn::RebindToSigned<D>;
using DU = hn::RebindToUnsigned<D>;
using V = hn::Vec<D>;
using VI = hn::Vec<DI>;
using VU = hn::Vec<DU>;

/// Converts whole numbers from 0 to 2^23. Cheaper than hn::ConvertTo, which saturates.
HWY_INLINE VI to_int(V v) {
  const V shift = hn::Set(D(), 8388608.f);  // 2^23: larger floats are whole
  return hn::Sub(hn::BitCast(DI(), hn::Add(v, shift)), hn::BitCast(DI(), shift));
}
HWY_INLINE V to_float(VI v) { return hn::ConvertTo(D(), v); }

/// Byte `k` of each lane, 0 the lowest.
template <int k>
HWY_INLINE V byte_of(VU v) {
  const DU d;
#if HWY_TARGET != HWY_SCALAR
  if constexpr (k == 1 || k == 2) {  // one step instead of a shift and a mask
    const hn::Repartition<std::uint8_t, DU> bytes;
    const VU lane = hn::And(hn::Iota(d, 0), hn::Set(d, 3));  // look-ups stay among four lanes
    const VU from = hn::Add(hn::ShiftLeft<2>(lane), hn::Set(d, 0x80808000u + k));
    const auto byte = hn::TableLookupBytesOr0(hn::BitCast(bytes, v), hn::BitCast(bytes, from));
    return to_float(hn::BitCast(DI(), byte));
  }
#endif
  const VU shifted = hn::ShiftRight<8 * k>(v);
  return to_float(hn::BitCast(DI(), k == 3 ? shifted : hn::And(shifted, hn::Set(d, 255))));
}

HWY_INLINE VI flag(hn::Mask<D> mask, std::int32_t value) {
  return hn::IfThenElseZero(hn::RebindMask(DI(), mask), hn::Set(DI(), value));
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#endif  // include guard
