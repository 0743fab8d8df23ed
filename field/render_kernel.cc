#include "field/render_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/render_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<float>;
using DI = hn::RebindToSigned<D>;
using DU = hn::RebindToUnsigned<D>;
using DD = hn::ScalableTag<double>;
using V = hn::Vec<D>;
using VI = hn::Vec<DI>;
using VD = hn::Vec<DD>;

HWY_INLINE VI to_int(V v) { return hn::ConvertTo(DI(), v); }
HWY_INLINE V to_float(VI v) { return hn::ConvertTo(D(), v); }
HWY_INLINE VI flag(hn::Mask<D> mask, std::int32_t value) {
  return hn::IfThenElseZero(hn::RebindMask(DI(), mask), hn::Set(DI(), value));
}
HWY_INLINE VI clamp_int(VI v, VI high) { return hn::Min(hn::Max(v, hn::Zero(DI())), high); }
HWY_INLINE VI mul_add(VI a, VI b, VI c) { return hn::Add(hn::Mul(a, b), c); }
HWY_INLINE VI choose(hn::Mask<D> mask, VI yes, VI no) {
  return hn::IfThenElse(hn::RebindMask(DI(), mask), yes, no);
}
HWY_INLINE void store(VI v, std::vector<std::uint32_t>& to, std::size_t k) {
  hn::StoreU(hn::BitCast(DU(), v), DU(), to.data() + k);
}
HWY_INLINE void store(V v, std::vector<float>& to, std::size_t k) {
  hn::StoreU(v, D(), to.data() + k);
}

/// As many points as there are lanes.
struct Point {
  V x, y, z;

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
  HWY_INLINE V dot(const Point& p) const {
    return hn::MulAdd(x, p.x, hn::MulAdd(y, p.y, hn::Mul(z, p.z)));
  }
};

/// Cells of a lattice, as slf::Cell.
struct Cells {
  VI octant, x, y;
  hn::Mask<D> inverted;
  V weight[3];
};

HWY_INLINE Cells locate(const Point& p, std::int32_t resolution) {
  const D d;
  const DI di;
  const V one = hn::Set(d, 1.f), zero = hn::Zero(d);
  const V ax = hn::Abs(p.x), ay = hn::Abs(p.y), az = hn::Abs(p.z);
  const V scale = hn::Div(hn::Set(d, static_cast<float>(resolution)), hn::Add(hn::Add(ax, ay), az));
  const V x = hn::Mul(ax, scale), y = hn::Mul(ay, scale);

  // Points on the far edges belong to the last cell, not to one beyond the octsphere.
  Cells cell;
  const VI last = hn::Set(di, resolution - 1);
  cell.octant = hn::Or(flag(hn::Lt(p.x, zero), 1),
                       hn::Or(flag(hn::Lt(p.y, zero), 2), flag(hn::Lt(p.z, zero), 4)));
  cell.x = clamp_int(to_int(x), last);
  cell.y = clamp_int(to_int(y), hn::Sub(last, cell.x));
  const V du = hn::Min(hn::Max(hn::Sub(x, to_float(cell.x)), zero), one);
  const V dv = hn::Min(hn::Max(hn::Sub(y, to_float(cell.y)), zero), one);

  // On the last diagonal du + dv exceeds 1 only by rounding: dv gives way.
  const auto diagonal = hn::RebindMask(d, hn::Eq(hn::Add(cell.x, cell.y), last));
  const V sum = hn::Add(du, dv), rest = hn::Sub(one, du), v = hn::Min(dv, rest);
  cell.inverted = hn::AndNot(diagonal, hn::Gt(sum, one));
  cell.weight[0] = hn::IfThenElse(cell.inverted, hn::Sub(sum, one), hn::Sub(rest, v));
  cell.weight[1] = hn::IfThenElse(cell.inverted, rest, du);
  cell.weight[2] = hn::IfThenElse(cell.inverted, hn::Sub(one, dv), v);
  return cell;
}

/// Stores what goes with a cell's corners: all three, or the one of the greatest weight.
HWY_INLINE void store_corners(const VI corners[3], const V weights[3], bool nearest, std::size_t k,
                              std::array<std::vector<std::uint32_t>, 3>& corner,
                              std::array<std::vector<float>, 3>& weight) {
  if (!nearest) {
    for (std::size_t c = 0; c < 3; ++c) {
      store(corners[c], corner[c], k);
      store(weights[c], weight[c], k);
    }
    return;
  }
  const auto second = hn::Gt(weights[1], weights[0]);
  const auto third = hn::Gt(weights[2], hn::Max(weights[0], weights[1]));
  store(choose(third, corners[2], choose(second, corners[1], corners[0])), corner[0], k);
  store(hn::Set(D(), 1.f), weight[0], k);
}

/// The unit direction of a lattice point, on the side of each axis that `side` is on.
HWY_INLINE Point vertex(VI x, VI y, std::int32_t resolution, const Point& side) {
  const VI z = hn::Sub(hn::Sub(hn::Set(DI(), resolution), x), y);
  const Point p{to_float(x), to_float(y), to_float(z)};
  const V inverse = hn::Div(hn::Set(D(), 1.f), hn::Sqrt(p.dot(p)));
  return {hn::CopySign(hn::Mul(p.x, inverse), side.x), hn::CopySign(hn::Mul(p.y, inverse), side.y),
          hn::CopySign(hn::Mul(p.z, inverse), side.z)};
}

struct DoublePoint {
  VD x, y, z;

  static HWY_INLINE DoublePoint set(const glm::dvec3& p) {
    return {hn::Set(DD(), p.x), hn::Set(DD(), p.y), hn::Set(DD(), p.z)};
  }
  HWY_INLINE DoublePoint plus(VD t, const DoublePoint& d) const {
    return {hn::MulAdd(t, d.x, x), hn::MulAdd(t, d.y, y), hn::MulAdd(t, d.z, z)};
  }
  HWY_INLINE VD dot(const DoublePoint& p) const {
    return hn::MulAdd(x, p.x, hn::MulAdd(y, p.y, hn::Mul(z, p.z)));
  }
};

using DH = hn::Rebind<float, DD>;
using DHI = hn::Rebind<std::int32_t, DD>;

/// Stores points as floats; where not `all`, the chosen ones one after the other.
HWY_INLINE void store_chosen(const DoublePoint& p, bool all, hn::Mask<DH> chosen, PointArrays& to,
                             std::size_t k) {
  const DH half;
  auto x = hn::DemoteTo(half, p.x), y = hn::DemoteTo(half, p.y), z = hn::DemoteTo(half, p.z);
  if (!all) x = hn::Compress(x, chosen), y = hn::Compress(y, chosen), z = hn::Compress(z, chosen);
  hn::StoreU(x, half, to.x.data() + k);
  hn::StoreU(y, half, to.y.data() + k);
  hn::StoreU(z, half, to.z.data() + k);
}

void cast_rays_any(const RayFan& fan, const PixelBlock& block, RayBlock& rays) {
  const DD d;
  const DoublePoint eye = DoublePoint::set(fan.eye), across = DoublePoint::set(fan.across);
  const VD x_end = hn::Set(d, block.x1);
  std::size_t n = 0;
  for (std::uint32_t y = block.y0; y < block.y1; ++y) {
    const DoublePoint row = DoublePoint::set(fan.corner + (y + 0.5) * fan.down);
    for (std::uint32_t x = block.x0; x < block.x1; x += hn::Lanes(d)) {
      const VD column = hn::Iota(d, x + 0.5);
      const DoublePoint direction = row.plus(column, across);

      // Find the ray's point closest to the centre, and half the chord around it. In double: eyes
      // may be far away.
      const VD length2 = direction.dot(direction);
      const VD middle = hn::Neg(hn::Div(eye.dot(direction), length2));
      const DoublePoint closest = eye.plus(middle, direction);
      const VD above = hn::Sub(hn::Set(d, 1.0), closest.dot(closest));
      const VD half = hn::Sqrt(hn::Div(hn::Max(above, hn::Zero(d)), length2));
      const auto ahead = hn::Gt(hn::Add(middle, half), hn::Zero(d));
      const auto hit = hn::And(hn::And(hn::Gt(above, hn::Zero(d)), ahead), hn::Lt(column, x_end));

      // Keep the rays that do.
      if (hn::AllFalse(d, hit)) continue;
      const bool all = hn::AllTrue(d, hit);
      const auto chosen =
          hn::Gt(hn::DemoteTo(DH(), hn::IfThenElseZero(hit, hn::Set(d, 1.0))), hn::Zero(DH()));
      store_chosen(closest.plus(hn::Neg(half), direction), all, chosen, rays.enter, n);
      store_chosen(closest.plus(half, direction), all, chosen, rays.leave, n);
      auto pixel = hn::Iota(DHI(), static_cast<std::int32_t>(y * fan.width + x));
      if (!all) pixel = hn::Compress(pixel, hn::RebindMask(DHI(), chosen));
      hn::StoreU(pixel, DHI(), reinterpret_cast<std::int32_t*>(rays.pixel.data() + n));
      n += hn::CountTrue(d, hit);
    }
  }
  rays.count = n;
}

void find_entries_any(const LevelGeometry& geometry, const RayBlock& rays, bool nearest,
                      bool with_points, EntryArrays& entries) {
  const DI di;
  const std::int32_t resolution = geometry.entry_resolution();
  const VI stride = hn::Set(di, resolution + 1), one = hn::Set(di, 1), zero = hn::Zero(di);
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(D())) {
    const Point enter = Point::load(rays.enter, k);
    const Cells cell = locate(enter, resolution);
    // Steps from the base to the corners, as Cell::corners() has them.
    const VI x_step[] = {choose(cell.inverted, one, zero), choose(cell.inverted, zero, one),
                         choose(cell.inverted, one, zero)};
    const VI y_step[] = {x_step[0], x_step[0], choose(cell.inverted, zero, one)};
    const VI base = mul_add(mul_add(cell.octant, stride, cell.y), stride, cell.x);
    VI corners[3];
    for (std::size_t c = 0; c < 3; ++c) {
      corners[c] = hn::Add(mul_add(y_step[c], stride, base), x_step[c]);
      if (with_points)
        vertex(hn::Add(cell.x, x_step[c]), hn::Add(cell.y, y_step[c]), resolution, enter)
            .store_to(entries.point[c], k);
    }
    store_corners(corners, cell.weight, nearest, k, entries.index, entries.weight);
  }
}

void find_exits_any(const LevelGeometry& geometry, const PointArrays& points, std::size_t count,
                    bool nearest, ExitArrays& exits) {
  const D d;
  const DI di;
  const auto level = static_cast<int>(geometry.level());
  const auto side = static_cast<std::int32_t>(geometry.exit_side());
  const auto* paths = reinterpret_cast<const std::int32_t*>(geometry.exit_paths().data());
  const VI n = hn::Set(di, side), one = hn::Set(di, 1);
  const V inverse = hn::Set(d, 1.f / static_cast<float>(side)), half = hn::Set(d, 0.5f);
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    const Cells cell = locate(Point::load(points, k), geometry.exit_resolution());
    // Divide by the side: half a cell keeps the quotients away from whole numbers.
    const VI sx = to_int(hn::Mul(hn::Add(to_float(cell.x), half), inverse));
    const VI sy = to_int(hn::Mul(hn::Add(to_float(cell.y), half), inverse));
    const VI rx = hn::Sub(cell.x, hn::Mul(sx, n)), ry = hn::Sub(cell.y, hn::Mul(sy, n));
    const VI cell_inverted = flag(cell.inverted, 1);
    const auto inverted =
        hn::RebindMask(d, hn::Gt(hn::Add(hn::Add(rx, ry), cell_inverted), hn::Sub(n, one)));
    const VI path =
        hn::Add(hn::ShiftLeft<1>(hn::Add(hn::ShiftLeftSame(sy, level), sx)), flag(inverted, 1));
    store(hn::Or(hn::ShiftLeftSame(cell.octant, 2 * level), hn::GatherIndex(di, paths, path)),
          exits.section, k);

    // The corner opposite the hypotenuse, then its neighbours along x and y, as in
    // LevelGeometry::exit_cell.
    VI p = hn::Add(rx, cell_inverted), q = hn::Add(ry, cell_inverted);
    p = choose(inverted, hn::Sub(n, p), p);
    q = choose(inverted, hn::Sub(n, q), q);
    const auto down = hn::Xor(flag(inverted, 1), cell_inverted);  // towards smaller coordinates
    const VI sign = hn::Sub(one, hn::ShiftLeft<1>(down));
    const VI line = hn::Sub(hn::Add(hn::Add(n, one), down), q);  // columns from q to q ± 1
    const VI before = hn::ShiftRight<1>(hn::Mul(q, hn::Sub(q, one)));
    const VI first = hn::Add(hn::Sub(hn::Mul(q, hn::Add(n, one)), before), p);
    const VI columns[] = {first, hn::Add(first, sign), mul_add(sign, line, first)};
    store_corners(columns, cell.weight, nearest, k, exits.column, exits.weight);
  }
}

void aim_at_depth_any(const RayBlock& rays, const EntryArrays& entries, const float* t,
                      std::array<PointArrays, 3>& aims) {
  const D d;
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const Point enter = Point::load(rays.enter, k);
    const Point seen = enter.plus(hn::LoadU(d, t + k), Point::load(rays.leave, k).minus(enter));
    for (std::size_t c = 0; c < 3; ++c) {
      const Point from = Point::load(entries.point[c], k);
      const Point along = seen.minus(from);
      const V length2 = along.dot(along);
      const V far = hn::Div(hn::Mul(hn::Set(d, -2.f), from.dot(along)), length2);
      from.plus(hn::IfThenElseZero(hn::Gt(length2, hn::Zero(d)), far), along).store_to(aims[c], k);
    }
  }
}

struct Colors {
  V r, g, b, a;
};

HWY_INLINE Colors load_rgba8(const std::vector<std::uint32_t>& from, std::size_t k) {
  const DI di;
  const VI v = hn::BitCast(di, hn::LoadU(DU(), from.data() + k)), byte = hn::Set(di, 255);
  return {to_float(hn::And(v, byte)), to_float(hn::And(hn::ShiftRight<8>(v), byte)),
          to_float(hn::And(hn::ShiftRight<16>(v), byte)),
          to_float(hn::And(hn::ShiftRight<24>(v), byte))};
}

HWY_INLINE Colors load_rgba(const std::vector<glm::vec4>& from, std::size_t k) {
  Colors v;
  hn::LoadInterleaved4(D(), &from[k].x, v.r, v.g, v.b, v.a);
  return v;
}

template <bool kHalf, bool kDepth>
void blend_typed(const Pass& pass, const RayBlock& rays, const EntryArrays& entries,
                 const SampleArrays& samples, glm::vec4* rgba, float* t) {
  const D d;
  const hn::Rebind<std::uint8_t, D> bytes;
  const V zero = hn::Zero(d), unit = hn::Set(d, kHalf ? 1.f : 1.f / 255);
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    Colors sum{zero, zero, zero, zero};
    V place = zero;  // depth along the ray, times opacity and the ray's squared length
    const Point enter = Point::load(rays.enter, k);
    const Point ray = Point::load(rays.leave, k).minus(enter);
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const V weight = hn::LoadU(d, entries.weight[c].data() + k);
      V opacity = zero, depth = zero;
      for (std::size_t e = 0; e < pass.exits; ++e) {
        const V w = hn::Mul(weight, hn::LoadU(d, pass.exit[c]->weight[e].data() + k));
        const Colors v = kHalf ? load_rgba(samples.rgba16f[3 * c + e], k)
                               : load_rgba8(samples.rgba8[3 * c + e], k);
        sum.r = hn::MulAdd(w, v.r, sum.r);
        sum.g = hn::MulAdd(w, v.g, sum.g);
        sum.b = hn::MulAdd(w, v.b, sum.b);
        if constexpr (kDepth) {
          const V visible = hn::Mul(w, v.a);
          const auto byte = hn::LoadU(bytes, samples.depth[3 * c + e].data() + k);
          opacity = hn::Add(opacity, visible);
          depth = hn::MulAdd(visible, to_float(hn::PromoteTo(DI(), byte)), depth);
        } else {
          opacity = hn::MulAdd(w, v.a, opacity);
        }
      }
      sum.a = hn::Add(sum.a, opacity);
      if constexpr (kDepth) {
        // Where the vertex's ray saw something, as a position along the pixel's.
        const Point from = Point::load(entries.point[c], k);
        const Point along = Point::load(*pass.aim[c], k).minus(from);
        const V share = hn::Mul(depth, hn::Set(d, 1.f / 255));
        place = hn::MulAdd(opacity, from.minus(enter).dot(ray), place);
        place = hn::MulAdd(share, along.dot(ray), place);
      }
    }
    if constexpr (kDepth) {
      const V at = hn::Div(place, hn::Mul(sum.a, ray.dot(ray)));
      const V inside = hn::Min(hn::Max(at, zero), hn::Set(d, 1.f));
      hn::StoreU(hn::IfThenElseZero(hn::Gt(sum.a, zero), inside), d, t + k);
    }
    hn::StoreInterleaved4(hn::Mul(sum.r, unit), hn::Mul(sum.g, unit), hn::Mul(sum.b, unit),
                          hn::Mul(sum.a, unit), d, &rgba[k].x);
  }
}

void blend_any(const Pass& pass, const RayBlock& rays, const EntryArrays& entries,
               const SampleArrays& samples, bool half_floats, glm::vec4* rgba, float* t) {
  const auto typed = half_floats
                         ? (pass.with_depth ? blend_typed<true, true> : blend_typed<true, false>)
                         : (pass.with_depth ? blend_typed<false, true> : blend_typed<false, false>);
  typed(pass, rays, entries, samples, rgba, t);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(cast_rays_any);
HWY_EXPORT(find_entries_any);
HWY_EXPORT(find_exits_any);
HWY_EXPORT(aim_at_depth_any);
HWY_EXPORT(blend_any);

void cast_rays(const RayFan& fan, const PixelBlock& block, RayBlock& rays) {
  HWY_DYNAMIC_DISPATCH(cast_rays_any)(fan, block, rays);
}

void find_entries(const LevelGeometry& geometry, const RayBlock& rays, bool nearest,
                  bool with_points, EntryArrays& entries) {
  HWY_DYNAMIC_DISPATCH(find_entries_any)(geometry, rays, nearest, with_points, entries);
}

void find_exits(const LevelGeometry& geometry, const PointArrays& points, std::size_t count,
                bool nearest, ExitArrays& exits) {
  HWY_DYNAMIC_DISPATCH(find_exits_any)(geometry, points, count, nearest, exits);
}

void aim_at_depth(const RayBlock& rays, const EntryArrays& entries, const float* t,
                  std::array<PointArrays, 3>& aims) {
  HWY_DYNAMIC_DISPATCH(aim_at_depth_any)(rays, entries, t, aims);
}

void blend(const Pass& pass, const RayBlock& rays, const EntryArrays& entries,
           const SampleArrays& samples, bool half_floats, glm::vec4* rgba, float* t) {
  HWY_DYNAMIC_DISPATCH(blend_any)(pass, rays, entries, samples, half_floats, rgba, t);
}

}  // namespace slf
#endif  // HWY_ONCE
