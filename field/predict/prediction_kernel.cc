#include "field/predict/prediction_kernel.h"

#include <algorithm>
#include <utility>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/predict/prediction_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include <hwy/highway.h>

#include "field/geometry/vectors-inl.h"

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

/// The coarser level. Its exit_paths() are held in a vector if they fit, which saves gathers.
class Exits {
 public:
  explicit Exits(const LevelGeometry& coarser)
      : geometry(coarser),
        paths_(reinterpret_cast<const std::int32_t*>(coarser.exit_paths().data())),
        fit_(coarser.exit_paths().size() <= hn::Lanes(DI())) {
    HWY_ALIGN std::int32_t lanes[hn::MaxLanes(DI())] = {};
    if (fit_) std::copy_n(paths_, coarser.exit_paths().size(), lanes);
    table_ = hn::Load(DI(), lanes);
  }
  [[nodiscard]] HWY_INLINE VI path(VI index) const {
    // One lane holds no table, and to check its index needs Highway's library, which builds that
    // only decode (tests/portable) do not link.
    if constexpr (hn::MaxLanes(DI()) > 1)
      if (fit_) return hn::TableLookupLanes(table_, hn::IndicesFromVec(DI(), index));
    return hn::GatherIndex(DI(), paths_, index);
  }

  const LevelGeometry& geometry;

 private:
  const std::int32_t* paths_;
  bool fit_;
  VI table_;
};

HWY_INLINE ExitCorners find_corners(const Exits& exits, const Exact& p, V scale) {
  const D d;
  const LevelGeometry& geometry = exits.geometry;
  const auto level = static_cast<int>(geometry.level());
  const auto side = static_cast<float>(geometry.exit_side());
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), half = hn::Set(d, 0.5f);
  const V all = hn::Set(d, 256.f);
  const V x = hn::Mul(hn::Abs(p.x), scale), y = hn::Mul(hn::Abs(p.y), scale);

  // The cell, and the position in it in steps of 1/256.
  const V last = hn::Set(d, static_cast<float>(geometry.exit_resolution() - 1));
  const V cell_x = hn::Min(hn::Floor(x), last);
  const V cell_y = hn::Min(hn::Floor(y), hn::Sub(last, cell_x));
  const auto steps = [&](V of, V cell) {
    const V at = hn::Min(hn::Sub(of, cell), one);
    return hn::Floor(hn::Add(hn::Mul(at, all), half));
  };
  const V f = steps(x, cell_x), g = steps(y, cell_y);
  const auto diagonal = hn::Eq(hn::Add(cell_x, cell_y), last);
  const V sum = hn::Add(f, g), rest = hn::Sub(all, f);
  const auto inverted_cell = hn::AndNot(diagonal, hn::Gt(sum, all));
  const V v = hn::Min(g, rest);  // on the last diagonal, rounding may make f + g too large

  ExitCorners corners;
  corners.weight[0] = hn::IfThenElse(inverted_cell, hn::Sub(sum, all), hn::Sub(rest, v));
  corners.weight[1] = hn::IfThenElse(inverted_cell, rest, f);
  corners.weight[2] = hn::IfThenElse(inverted_cell, hn::Sub(all, g), v);

  // The section and its columns, as in LevelGeometry: whole numbers, which floats hold exactly.
  const VI octant = hn::Add(
      hn::Add(flag(hn::Lt(p.x, zero), 1 << 2 * level), flag(hn::Lt(p.y, zero), 2 << 2 * level)),
      flag(hn::Lt(p.z, zero), 4 << 2 * level));
  const V n = hn::Set(d, side), inverse = hn::Set(d, 1 / side);
  const V sx = hn::Floor(hn::Mul(hn::Add(cell_x, half), inverse));
  const V sy = hn::Floor(hn::Mul(hn::Add(cell_y, half), inverse));
  const V beyond = hn::IfThenElseZero(inverted_cell, one);
  V column = hn::Add(hn::Sub(cell_x, hn::Mul(sx, n)), beyond);
  V line = hn::Add(hn::Sub(cell_y, hn::Mul(sy, n)), beyond);
  const auto inverted = hn::Gt(hn::Sub(hn::Add(column, line), beyond), hn::Sub(n, one));
  const V path =
      hn::Add(hn::Add(hn::Mul(sy, hn::Set(d, static_cast<float>(2 << level))), hn::Add(sx, sx)),
              hn::IfThenElseZero(inverted, one));
  corners.section = hn::Add(octant, exits.path(to_int(path)));

  column = hn::IfThenElse(inverted, hn::Sub(n, column), column);
  line = hn::IfThenElse(inverted, hn::Sub(n, line), line);
  const auto back = hn::Xor(inverted, inverted_cell);  // towards smaller coordinates
  const V before = hn::IfThenElseZero(back, one);
  const V length = hn::Sub(hn::Add(hn::Add(n, one), before), line);
  const V start = hn::Mul(line, hn::Sub(hn::Set(d, side + 1.5f), hn::Mul(line, half)));
  const V first = hn::Add(start, column);
  corners.column[0] = to_int(first);
  corners.column[1] = to_int(hn::Add(first, hn::Sub(one, hn::Add(before, before))));
  corners.column[2] = to_int(hn::IfThenElse(back, hn::Sub(first, length), hn::Add(first, length)));
  return corners;
}

/// The ray from a reference's vertex e' through the point at depth d on the ray from e along r.
struct Aim {
  V ev, vv;  ///< the dot products e'·v and v·v, where v points from e' to that point
  ExitCorners corners;
};

/// Aims from e' (`from`) at the point e + d·r; `w` is e - e'. If the point is e' itself, the ray
/// goes to `leave`, the end Q of the ray from e.
HWY_INLINE Aim aim(const Exits& coarser, const Exact& from, const Exact& w, const Exact& r,
                   const Exact& leave, V d) {
  const D tag;
  const Exact v = w.plus(r.times(d));
  Aim to;
  to.vv = v.dot(v);
  to.ev = from.dot(v);
  Exact q = from.times(to.vv).minus(v.times(hn::Add(to.ev, to.ev)));
  const auto norm = [](const Exact& p) {
    return hn::Add(hn::Add(hn::Abs(p.x), hn::Abs(p.y)), hn::Abs(p.z));
  };
  const auto some = hn::Gt(norm(q), hn::Set(tag, 0x1p-40f));
  q = q.or_else(some, leave);
  const V resolution = hn::Set(tag, static_cast<float>(coarser.geometry.exit_resolution()));
  to.corners = find_corners(coarser, q, hn::Div(resolution, norm(q)));
  return to;
}

/// Calls use(tile, lanes) for each tile that some lanes need, mostly a single one.
template <class Use>
HWY_INLINE void for_each_tile(const ReferenceVertex& from, VI section, hn::Mask<D> wanted,
                              Use use) {
  const DI d;
  const std::int32_t first = hn::GetLane(section);
  if (hn::AllTrue(d, hn::Eq(section, hn::Set(d, first)))) {
    const auto here = hn::RebindMask(d, wanted);
    if (from.uses) from.uses[first] += static_cast<std::uint32_t>(hn::CountTrue(d, here));
    if (from.tiles[first].color) use(from.tiles[first], here);
    return;
  }
  HWY_ALIGN std::int32_t sections[hn::MaxLanes(DI())];
  hn::Store(section, d, sections);
  auto left = hn::RebindMask(d, wanted);
  for (auto lane = hn::FindFirstTrue(d, left); lane >= 0; lane = hn::FindFirstTrue(d, left)) {
    const std::int32_t s = sections[lane];
    const auto here = hn::And(left, hn::Eq(section, hn::Set(d, s)));
    left = hn::AndNot(here, left);
    if (from.uses) from.uses[s] += static_cast<std::uint32_t>(hn::CountTrue(d, here));
    if (from.tiles[s].color) use(from.tiles[s], here);
  }
}

void predict_alpha_depth_any(const LevelGeometry& coarser, const PredictedRow& row,
                             const Points& points, std::size_t count, std::uint8_t* alpha,
                             std::uint8_t* depth) {
  const D d;
  const DI di;
  const DU du;
  const hn::Rebind<std::uint8_t, DI> bytes;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), half = hn::Set(d, 0.5f);
  const V full = hn::Set(d, 255.f);
  const Exact e = Exact::set(row.x, row.y, row.z);
  const Exits exits(coarser);
  // A ray from the same vertex needs no correction by depth.
  const int rounds = row.references == 1 ? 1 : 3;
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    const Exact leave{hn::LoadU(d, &points.x[k]), hn::LoadU(d, &points.y[k]),
                      hn::LoadU(d, &points.z[k])};
    const Exact r = leave.minus(e);
    const V rr = r.dot(r);
    const auto some_length = hn::Gt(rr, hn::Set(d, 0x1p-40f));
    const V inverse = hn::Div(one, hn::IfThenElse(some_length, rr, one));
    V t = one, opacity = zero;
    for (int round = 0; round < rounds; ++round) {
      V place = zero;
      opacity = zero;
      for (std::size_t c = 0; c < row.references; ++c) {
        const ReferenceVertex& from = row.reference[c];
        const Exact start = Exact::set(from.x, from.y, from.z);
        const Exact w = e.minus(start);
        const Aim to = aim(exits, start, w, r, leave, t);
        VI rgba[3] = {hn::Zero(di), hn::Zero(di), hn::Zero(di)};
        VI deep[3] = {hn::Zero(di), hn::Zero(di), hn::Zero(di)};
        for_each_tile(
            from, to.corners.section, hn::Eq(zero, zero),
            [&](const ReferenceTile& tile, auto here) {
              const auto* colors = reinterpret_cast<const std::int32_t*>(tile.color) + from.row;
              const auto* depths = reinterpret_cast<const std::int32_t*>(tile.depth + from.row - 3);
              for (int corner = 0; corner < 3; ++corner) {
                const VI column = hn::IfThenElseZero(here, to.corners.column[corner]);
                rgba[corner] =
                    hn::IfThenElse(here, hn::GatherIndex(di, colors, column), rgba[corner]);
                if (hn::AllFalse(di, hn::Ne(rgba[corner], hn::Zero(di)))) continue;
                deep[corner] =
                    hn::IfThenElse(here, hn::GatherOffset(di, depths, column), deep[corner]);
              }
            });
        V a = zero, n = zero;
        for (int corner = 0; corner < 3; ++corner) {
          const V share =
              hn::Mul(to.corners.weight[corner], byte_of<3>(hn::BitCast(du, rgba[corner])));
          a = hn::Add(a, share);
          n = hn::Add(n, hn::Mul(share, byte_of<3>(hn::BitCast(du, deep[corner]))));
        }
        const auto seen = hn::Gt(a, zero);
        const V own = hn::Div(n, hn::Mul(hn::IfThenElse(seen, a, one), full));
        const auto directed = hn::Gt(to.vv, hn::Set(d, 0x1p-40f));
        const V reach =
            hn::Div(hn::Neg(hn::Add(to.ev, to.ev)), hn::IfThenElse(directed, to.vv, one));
        const V wr = w.dot(r);
        const V along = hn::Mul(
            hn::Sub(hn::Mul(hn::Mul(own, reach), hn::Add(wr, hn::Mul(t, rr))), wr), inverse);
        opacity = hn::Add(opacity, a);
        place = hn::Add(place, hn::Mul(a, along));
      }
      const auto seen = hn::Gt(opacity, zero);
      const V mean = hn::Div(place, hn::IfThenElse(seen, opacity, one));
      const V before = std::exchange(t, hn::IfThenElse(seen, hn::Min(hn::Max(mean, zero), one), t));
      if (hn::AllTrue(d, hn::Eq(t, before))) break;  // as frequent as rays that see nothing
    }
    const V share = hn::Set(d, row.references == 1 ? 0x1p-8f : 0x1p-9f);
    const VI a = to_int(hn::Floor(hn::Add(hn::Mul(opacity, share), half)));
    const VI z = to_int(hn::Floor(hn::Add(hn::Mul(t, full), half)));
    hn::StoreU(hn::DemoteTo(bytes, a), bytes, alpha + k);
    hn::StoreU(hn::DemoteTo(bytes, z), bytes, depth + k);
  }
}

void predict_color_any(const LevelGeometry& coarser, const PredictedRow& row, const Points& points,
                       std::size_t count, const std::uint8_t* alpha, const std::uint8_t* depth,
                       std::uint32_t* color) {
  const D d;
  const DI di;
  const DU du;
  const hn::Rebind<std::uint8_t, DI> bytes;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), half = hn::Set(d, 0.5f);
  const V full = hn::Set(d, 255.f);
  const Exact e = Exact::set(row.x, row.y, row.z);
  const Exits exits(coarser);
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    const VI own_alpha = hn::PromoteTo(di, hn::LoadU(bytes, alpha + k));
    const auto visible = hn::RebindMask(d, hn::Gt(own_alpha, hn::Zero(di)));
    if (hn::AllFalse(d, visible)) {
      hn::StoreU(hn::Zero(du), du, color + k);
      continue;
    }
    const Exact leave{hn::LoadU(d, &points.x[k]), hn::LoadU(d, &points.y[k]),
                      hn::LoadU(d, &points.z[k])};
    const Exact r = leave.minus(e);
    const V t = row.references == 1
                    ? one
                    : hn::Div(to_float(hn::PromoteTo(di, hn::LoadU(bytes, depth + k))), full);
    V sum[4] = {zero, zero, zero, zero};
    for (std::size_t c = 0; c < row.references; ++c) {
      const ReferenceVertex& from = row.reference[c];
      const Exact start = Exact::set(from.x, from.y, from.z);
      const Aim to = aim(exits, start, e.minus(start), r, leave, t);
      VI rgba[3] = {hn::Zero(di), hn::Zero(di), hn::Zero(di)};
      for_each_tile(from, to.corners.section, visible, [&](const ReferenceTile& tile, auto here) {
        const auto* colors = reinterpret_cast<const std::int32_t*>(tile.color) + from.row;
        for (int corner = 0; corner < 3; ++corner) {
          const VI column = hn::IfThenElseZero(here, to.corners.column[corner]);
          rgba[corner] = hn::IfThenElse(here, hn::GatherIndex(di, colors, column), rgba[corner]);
        }
      });
      for (int corner = 0; corner < 3; ++corner) {
        const VU v = hn::BitCast(du, rgba[corner]);
        const V weight = to.corners.weight[corner];
        sum[0] = hn::Add(sum[0], hn::Mul(weight, byte_of<0>(v)));
        sum[1] = hn::Add(sum[1], hn::Mul(weight, byte_of<1>(v)));
        sum[2] = hn::Add(sum[2], hn::Mul(weight, byte_of<2>(v)));
        sum[3] = hn::Add(sum[3], hn::Mul(weight, byte_of<3>(v)));
      }
    }
    const auto seen = hn::And(visible, hn::Gt(sum[3], zero));
    const V inverse = hn::Div(full, hn::IfThenElse(seen, sum[3], one));
    const auto channel = [&](V of) {
      return to_int(hn::Floor(hn::Add(hn::Min(hn::Mul(of, inverse), full), half)));
    };
    const VI rgb = hn::Or(hn::Or(channel(sum[0]), hn::ShiftLeft<8>(channel(sum[1]))),
                          hn::Or(hn::ShiftLeft<16>(channel(sum[2])),
                                 hn::Set(di, static_cast<std::int32_t>(0xFF000000u))));
    hn::StoreU(hn::BitCast(du, hn::IfThenElseZero(hn::RebindMask(di, seen), rgb)), du, color + k);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(predict_alpha_depth_any);
HWY_EXPORT(predict_color_any);

void predict_alpha_depth(const LevelGeometry& coarser, const PredictedRow& row,
                         const Points& points, std::size_t count, std::uint8_t* alpha,
                         std::uint8_t* depth) {
  HWY_DYNAMIC_DISPATCH(predict_alpha_depth_any)(coarser, row, points, count, alpha, depth);
}

void predict_color(const LevelGeometry& coarser, const PredictedRow& row, const Points& points,
                   std::size_t count, const std::uint8_t* alpha, const std::uint8_t* depth,
                   std::uint32_t* color) {
  HWY_DYNAMIC_DISPATCH(predict_color_any)(coarser, row, points, count, alpha, depth, color);
}

}  // namespace slf
#endif  // HWY_ONCE
