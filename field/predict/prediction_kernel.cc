#include "field/predict/prediction_kernel.h"

#include <utility>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/predict/prediction_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include <hwy/highway.h>

#include "field/geometry/cells-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

/// Points and vectors whose arithmetic rounds after each operation, in the order written.
struct Exact {
  V x, y, z;

  static HWY_INLINE Exact set(float x, float y, float z) {
    return {hn::Set(D(), x), hn::Set(D(), y), hn::Set(D(), z)};
  }
  HWY_INLINE Exact minus(const Exact& p) const {
    return {hn::Sub(x, p.x), hn::Sub(y, p.y), hn::Sub(z, p.z)};
  }
  HWY_INLINE Exact plus(const Exact& p) const {
    return {hn::Add(x, p.x), hn::Add(y, p.y), hn::Add(z, p.z)};
  }
  HWY_INLINE Exact times(V t) const { return {hn::Mul(x, t), hn::Mul(y, t), hn::Mul(z, t)}; }
  HWY_INLINE V dot(const Exact& p) const {
    return hn::Add(hn::Add(hn::Mul(x, p.x), hn::Mul(y, p.y)), hn::Mul(z, p.z));
  }
  HWY_INLINE Exact or_else(hn::Mask<D> use, const Exact& p) const {
    return {hn::IfThenElse(use, x, p.x), hn::IfThenElse(use, y, p.y), hn::IfThenElse(use, z, p.z)};
  }
};

/// Three exit vertices of the coarser level, and their weights in 1/256.
struct ExitCorners {
  VI section;
  VI column[3];
  V weight[3];
};

HWY_INLINE ExitCorners find_corners(const ExitFinder& exits, const Exact& p) {
  const Cells cell = exits.cells<256>(p);
  const ExitPlaces at = exits.places(cell);
  const V one = hn::Set(D(), 1.f);
  const V second = hn::Add(at.first, hn::IfThenElse(at.down, hn::Neg(one), one));
  return {at.section,
          {to_int(at.first), to_int(second), to_int(at.third)},
          {cell.weight[0], cell.weight[1], cell.weight[2]}};
}

/// The ray from a reference's vertex e' through the point at depth d on the ray from e along r.
struct Aim {
  V ev, vv;  ///< the dot products e'·v and v·v, where v points from e' to that point
  ExitCorners corners;
};

/// Aims from e' (`from`) at the point e + d·r; `w` is e - e'. If the point is e' itself, the ray
/// goes to `leave`, the end Q of the ray from e.
HWY_INLINE Aim aim(const ExitFinder& exits, const Exact& from, const Exact& w, const Exact& r,
                   const Exact& leave, V d) {
  const D tag;
  const Exact v = w.plus(r.times(d));
  Aim to;
  to.vv = v.dot(v);
  to.ev = from.dot(v);
  Exact q = from.times(to.vv).minus(v.times(hn::Add(to.ev, to.ev)));
  q = q.or_else(hn::Gt(norm1(q), hn::Set(tag, 0x1p-40f)), leave);
  to.corners = find_corners(exits, q);
  return to;
}

/// Calls use(section, lanes) for each exit section that some lanes need, mostly a single one.
template <class Use>
HWY_INLINE void for_each_section(VI section, hn::Mask<DI> wanted, Use use) {
  const DI d;
  const std::int32_t first = hn::GetLane(section);
  if (hn::AllTrue(d, hn::Eq(section, hn::Set(d, first)))) return use(first, wanted);
  HWY_ALIGN std::int32_t sections[hn::MaxLanes(DI())];
  hn::Store(section, d, sections);
  auto left = wanted;
  for (auto lane = hn::FindFirstTrue(d, left); lane >= 0; lane = hn::FindFirstTrue(d, left)) {
    const auto here = hn::And(left, hn::Eq(section, hn::Set(d, sections[lane])));
    left = hn::AndNot(here, left);
    use(sections[lane], here);
  }
}

/// The rays of a row to a vector of points.
struct Rays {
  Exact e, leave, r;
  V rr, inverse;  // r·r; 1 over it

  Rays(const PredictedRow& row, const Points& points, std::size_t k)
      : e(Exact::set(row.x, row.y, row.z)),
        leave{hn::LoadU(D(), &points.x[k]), hn::LoadU(D(), &points.y[k]),
              hn::LoadU(D(), &points.z[k])},
        r(leave.minus(e)),
        rr(r.dot(r)) {
    const V one = hn::Set(D(), 1.f);
    inverse = hn::Div(one, hn::IfThenElse(hn::Gt(rr, hn::Set(D(), 0x1p-40f)), rr, one));
  }
};

/// What the references show of rays. Sums over references and corners, times 256.
struct Seen {
  V opacity;
  V place;     // opacity times the depth along the ray
  V color[3];  // premultiplied
};

/// Looks rays up at depth t. Colours are left out unless `kColor`.
template <bool kColor>
HWY_INLINE Seen look_up(const ExitFinder& exits, const PredictedRow& row, const Rays& rays, V t) {
  const D d;
  const DI di;
  const DU du;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f);
  Seen seen{zero, zero, {zero, zero, zero}};
  for (std::size_t c = 0; c < row.references; ++c) {
    const ReferenceVertex& from = row.reference[c];
    const Exact start = Exact::set(from.x, from.y, from.z);
    const Exact w = rays.e.minus(start);
    const Aim to = aim(exits, start, w, rays.r, rays.leave, t);
    VI rgba[3] = {hn::Zero(di), hn::Zero(di), hn::Zero(di)};
    VI deep[3] = {hn::Zero(di), hn::Zero(di), hn::Zero(di)};
    for_each_section(
        to.corners.section, hn::Eq(hn::Zero(di), hn::Zero(di)), [&](std::int32_t s, auto here) {
          const ReferenceTile& tile = from.tiles[s];
          if (!tile.color) return;
          const auto* colors = reinterpret_cast<const std::int32_t*>(tile.color) + from.row_begin;
          const auto* depths =
              reinterpret_cast<const std::int32_t*>(tile.depth + from.row_begin - 3);
          for (int corner = 0; corner < 3; ++corner) {
            const VI column = hn::IfThenElseZero(here, to.corners.column[corner]);
            rgba[corner] = hn::IfThenElse(here, hn::GatherIndex(di, colors, column), rgba[corner]);
            if (hn::AllFalse(di, hn::Ne(rgba[corner], hn::Zero(di)))) continue;
            deep[corner] = hn::IfThenElse(here, hn::GatherOffset(di, depths, column), deep[corner]);
          }
        });
    V a = zero, n = zero;
    for (int corner = 0; corner < 3; ++corner) {
      const V weight = to.corners.weight[corner];
      const VU color = hn::BitCast(du, rgba[corner]);
      const V share = hn::Mul(weight, byte_of<3>(color));
      a = hn::Add(a, share);
      n = hn::Add(n, hn::Mul(share, byte_of<3>(hn::BitCast(du, deep[corner]))));
      if constexpr (kColor) {
        seen.color[0] = hn::Add(seen.color[0], hn::Mul(weight, byte_of<0>(color)));
        seen.color[1] = hn::Add(seen.color[1], hn::Mul(weight, byte_of<1>(color)));
        seen.color[2] = hn::Add(seen.color[2], hn::Mul(weight, byte_of<2>(color)));
      }
    }
    const V some = hn::IfThenElse(hn::Gt(a, zero), a, one);
    const V own = hn::Div(n, hn::Mul(some, hn::Set(d, 255.f)));
    const auto directed = hn::Gt(to.vv, hn::Set(d, 0x1p-40f));
    const V reach = hn::Div(hn::Neg(hn::Add(to.ev, to.ev)), hn::IfThenElse(directed, to.vv, one));
    const V wr = w.dot(rays.r);
    const V along = hn::Mul(
        hn::Sub(hn::Mul(hn::Mul(own, reach), hn::Add(wr, hn::Mul(t, rays.rr))), wr), rays.inverse);
    seen.opacity = hn::Add(seen.opacity, a);
    seen.place = hn::Add(seen.place, hn::Mul(a, along));
  }
  return seen;
}

/// The mean depth of what is seen; `t` where nothing is.
HWY_INLINE V depth_of(const Seen& seen, V t) {
  const V zero = hn::Zero(D()), one = hn::Set(D(), 1.f);
  const auto some = hn::Gt(seen.opacity, zero);
  const V mean = hn::Div(seen.place, hn::IfThenElse(some, seen.opacity, one));
  return hn::IfThenElse(some, hn::Min(hn::Max(mean, zero), one), t);
}

HWY_INLINE VI rounded(V v) { return to_int(hn::Floor(hn::Add(v, hn::Set(D(), 0.5f)))); }

HWY_INLINE void store_bytes(V v, std::uint8_t* to) {
  const hn::Rebind<std::uint8_t, DI> bytes;
  hn::StoreU(hn::DemoteTo(bytes, rounded(v)), bytes, to);
}

HWY_INLINE VI load_bytes(const std::uint8_t* from) {
  return hn::PromoteTo(DI(), hn::LoadU(hn::Rebind<std::uint8_t, DI>(), from));
}

/// A sum over the row's references and the corners, as a mean.
HWY_INLINE V mean_of(const PredictedRow& row, V sum) {
  return hn::Mul(sum, hn::Set(D(), row.references == 1 ? 0x1p-8f : 0x1p-9f));
}

/// Look-ups of a ray, each at the depth that the one before it found.
constexpr int kRounds = 3;

void find_depth_any(const LevelGeometry& coarser, const PredictedRow& row, const Points& points,
                    std::size_t count, std::uint8_t* alpha, std::uint8_t* depth) {
  const D d;
  const ExitFinder exits(coarser);
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    const Rays rays(row, points, k);
    V t = hn::Set(d, 1.f);
    Seen seen = look_up<false>(exits, row, rays, t);
    for (int round = 1; round < kRounds; ++round) {
      const V before = std::exchange(t, depth_of(seen, t));
      if (hn::AllTrue(d, hn::Eq(t, before))) break;  // as frequent as rays that see nothing
      seen = look_up<false>(exits, row, rays, t);
    }
    t = depth_of(seen, t);
    store_bytes(mean_of(row, seen.opacity), alpha + k);
    store_bytes(hn::Mul(t, hn::Set(d, 255.f)), depth + k);
  }
}

void predict_samples_any(const LevelGeometry& coarser, const PredictedRow& row,
                         const Points& points, std::size_t count, std::uint8_t* alpha,
                         std::uint8_t* depth, std::uint32_t* color) {
  const D d;
  const DI di;
  const DU du;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), full = hn::Set(d, 255.f);
  const ExitFinder exits(coarser);
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    // A ray from the same vertex needs no correction by depth.
    const V t = row.references == 1 ? one : hn::Div(to_float(load_bytes(depth + k)), full);
    const Seen seen = look_up<true>(exits, row, Rays(row, points, k), t);
    store_bytes(mean_of(row, seen.opacity), alpha + k);
    store_bytes(hn::Mul(depth_of(seen, t), full), depth + k);
    const auto some = hn::Gt(seen.opacity, zero);
    const V inverse = hn::Div(full, hn::IfThenElse(some, seen.opacity, one));
    const auto channel = [&](std::size_t c) {
      return rounded(hn::Min(hn::Mul(seen.color[c], inverse), full));
    };
    const VI rgb = hn::Or(
        hn::Or(channel(0), hn::ShiftLeft<8>(channel(1))),
        hn::Or(hn::ShiftLeft<16>(channel(2)), hn::Set(di, static_cast<std::int32_t>(0xFF000000u))));
    hn::StoreU(hn::BitCast(du, hn::IfThenElseZero(hn::RebindMask(di, some), rgb)), du, color + k);
  }
}

void count_uses_any(const LevelGeometry& coarser, const PredictedRow& row, const Points& points,
                    std::size_t count, const std::uint8_t* alpha, const std::uint8_t* depth) {
  const D d;
  const DI di;
  const ExitFinder exits(coarser);
  const V one = hn::Set(d, 1.f), full = hn::Set(d, 255.f);
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    const auto visible = hn::Gt(load_bytes(alpha + k), hn::Zero(di));
    if (hn::AllFalse(di, visible)) continue;
    const Rays rays(row, points, k);
    const V t = row.references == 1 ? one : hn::Div(to_float(load_bytes(depth + k)), full);
    for (std::size_t c = 0; c < row.references; ++c) {
      const ReferenceVertex& from = row.reference[c];
      const Exact start = Exact::set(from.x, from.y, from.z);
      const Aim to = aim(exits, start, rays.e.minus(start), rays.r, rays.leave, t);
      for_each_section(to.corners.section, visible, [&](std::int32_t s, auto here) {
        from.uses[s] += static_cast<std::uint32_t>(hn::CountTrue(di, here));
      });
    }
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(find_depth_any);
HWY_EXPORT(predict_samples_any);
HWY_EXPORT(count_uses_any);

void find_depth(const LevelGeometry& coarser, const PredictedRow& row, const Points& points,
                std::size_t count, std::uint8_t* alpha, std::uint8_t* depth) {
  HWY_DYNAMIC_DISPATCH(find_depth_any)(coarser, row, points, count, alpha, depth);
}

void predict_samples(const LevelGeometry& coarser, const PredictedRow& row, const Points& points,
                     std::size_t count, std::uint8_t* alpha, std::uint8_t* depth,
                     std::uint32_t* color) {
  HWY_DYNAMIC_DISPATCH(predict_samples_any)(coarser, row, points, count, alpha, depth, color);
}

void count_uses(const LevelGeometry& coarser, const PredictedRow& row, const Points& points,
                std::size_t count, const std::uint8_t* alpha, const std::uint8_t* depth) {
  HWY_DYNAMIC_DISPATCH(count_uses_any)(coarser, row, points, count, alpha, depth);
}

}  // namespace slf
#endif  // HWY_ONCE
