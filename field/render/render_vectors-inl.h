// Vectors of pixels and of points. The kernels of field/render and those of benchmarks/plane
// include this.

// Included once per instruction set.
#if defined(SLF_FIELD_RENDER_VECTORS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLF_FIELD_RENDER_VECTORS_INL_H_
#undef SLF_FIELD_RENDER_VECTORS_INL_H_
#else
#define SLF_FIELD_RENDER_VECTORS_INL_H_
#endif

#include <hwy/highway.h>

#include "field/geometry/vectors-inl.h"
#include "field/render/ray_block.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

HWY_INLINE VI mul_add(VI a, VI b, VI c) { return hn::Add(hn::Mul(a, b), c); }
HWY_INLINE VI choose(hn::Mask<D> mask, VI yes, VI no) {
  return hn::IfThenElse(hn::RebindMask(DI(), mask), yes, no);
}
HWY_INLINE V choose(hn::Mask<D> mask, V yes, V no) { return hn::IfThenElse(mask, yes, no); }
HWY_INLINE void store(VI v, RayArray<std::uint32_t>& to, std::size_t k) {
  hn::StoreU(hn::BitCast(DU(), v), DU(), to.data() + k);
}
HWY_INLINE void store(V v, RayArray<float>& to, std::size_t k) {
  hn::StoreU(v, D(), to.data() + k);
}

/// As many pixels as there are lanes, in a square if possible, because their rays then mostly need
/// the same tiles.
struct PixelSquare {
  static constexpr std::uint32_t kAcross = hn::MaxLanes(D()) < 4 ? 1 : 4;
  static constexpr std::uint32_t kDown = hn::MaxLanes(D()) / kAcross;
  V right, down;  ///< in pixels from the first
  VU index;       ///< offset in the picture from the first

  /// `width` is that of the picture.
  HWY_INLINE explicit PixelSquare(std::uint32_t width) {
    const DU d;
    const VU lane = hn::Iota(d, 0), x = hn::And(lane, hn::Set(d, kAcross - 1));
    const VU y = hn::ShiftRight<hwy::CeilLog2(kAcross)>(lane);
    right = to_float(hn::BitCast(DI(), x));
    down = to_float(hn::BitCast(DI(), y));
    index = hn::Add(hn::Mul(y, hn::Set(d, width)), x);
  }
};

/// As many points as there are lanes.
struct Point {
  V x, y, z;

  static HWY_INLINE Point set(const glm::dvec3& p) {
    const glm::vec3 f(p);
    return {hn::Set(D(), f.x), hn::Set(D(), f.y), hn::Set(D(), f.z)};
  }
  static HWY_INLINE Point load(const PointArrays& from, std::size_t k) {
    return {hn::LoadU(D(), from.x.data() + k), hn::LoadU(D(), from.y.data() + k),
            hn::LoadU(D(), from.z.data() + k)};
  }
  HWY_INLINE void store_to(PointArrays& to, std::size_t k) const {
    store(x, to.x, k), store(y, to.y, k), store(z, to.z, k);
  }
  HWY_INLINE Point minus(const Point& p) const {
    return {hn::Sub(x, p.x), hn::Sub(y, p.y), hn::Sub(z, p.z)};
  }
  HWY_INLINE Point plus(V t, const Point& d) const {
    return {hn::MulAdd(t, d.x, x), hn::MulAdd(t, d.y, y), hn::MulAdd(t, d.z, z)};
  }
  HWY_INLINE Point times(V t) const { return {hn::Mul(x, t), hn::Mul(y, t), hn::Mul(z, t)}; }
  HWY_INLINE V dot(const Point& p) const {
    return hn::MulAdd(x, p.x, hn::MulAdd(y, p.y, hn::Mul(z, p.z)));
  }
  HWY_INLINE Point cross(const Point& p) const {
    return {hn::MulSub(y, p.z, hn::Mul(z, p.y)), hn::MulSub(z, p.x, hn::Mul(x, p.z)),
            hn::MulSub(x, p.y, hn::Mul(y, p.x))};
  }
};

/// Stores the chosen lanes one after the other.
template <class DT, class T>
HWY_INLINE void store_chosen(hn::Vec<DT> v, bool all, hn::Mask<D> chosen, DT d, T* to) {
  hn::StoreU(all ? v : hn::Compress(v, hn::RebindMask(d, chosen)), d, to);
}

HWY_INLINE void store_chosen(const Point& p, bool all, hn::Mask<D> chosen, PointArrays& to,
                             std::size_t k) {
  store_chosen(p.x, all, chosen, D(), to.x.data() + k);
  store_chosen(p.y, all, chosen, D(), to.y.data() + k);
  store_chosen(p.z, all, chosen, D(), to.z.data() + k);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#endif  // include guard
