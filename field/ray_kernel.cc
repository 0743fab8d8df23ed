#include "field/ray_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/ray_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include "field/render_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

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

/// Which of three weights is the greatest.
struct Nearest {
  hn::Mask<D> second, third;

  static HWY_INLINE Nearest of(const V weight[3]) {
    return {hn::Gt(weight[1], weight[0]), hn::Gt(weight[2], hn::Max(weight[0], weight[1]))};
  }
  HWY_INLINE VI choose_from(const VI v[3]) const {
    return choose(third, v[2], choose(second, v[1], v[0]));
  }
};

/// The unit direction of a lattice point, on the side of each axis that `side` is on.
HWY_INLINE Point vertex(VI x, VI y, std::int32_t resolution, const Point& side) {
  const VI z = hn::Sub(hn::Sub(hn::Set(DI(), resolution), x), y);
  const Point p{to_float(x), to_float(y), to_float(z)};
  const V inverse = hn::Div(hn::Set(D(), 1.f), hn::Sqrt(p.dot(p)));
  return {hn::CopySign(hn::Mul(p.x, inverse), side.x), hn::CopySign(hn::Mul(p.y, inverse), side.y),
          hn::CopySign(hn::Mul(p.z, inverse), side.z)};
}

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

void cast_rays_any(const RayFan& fan, const PixelBlock& block, RayBlock& rays) {
  const D d;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f);
  const Point across = Point::set(fan.across), turn = Point::set(glm::cross(fan.eye, fan.across));
  const V forward = hn::Set(d, static_cast<float>(glm::dot(fan.eye, fan.across)));
  std::size_t n = 0;
  for (std::uint32_t y = block.y0; y < block.y1; ++y) {
    for (std::uint32_t x = block.x0; x < block.x1; x += hn::Lanes(d)) {
      // Directions and moments (eye × direction) are linear in x: from a start in double, because
      // eyes may be far away, a few steps in float lose nothing.
      const glm::dvec3 start = fan.corner + (x + 0.5) * fan.across + (y + 0.5) * fan.down;
      const V step = hn::Iota(d, 0);
      const Point direction = Point::set(start).plus(step, across);
      const Point moment = Point::set(glm::cross(fan.eye, start)).plus(step, turn);
      const V along =
          hn::MulAdd(step, forward, hn::Set(d, static_cast<float>(glm::dot(fan.eye, start))));

      // Find the ray's point closest to the centre, and half the chord around it.
      const V inverse = hn::Div(one, direction.dot(direction));
      const V above = hn::NegMulAdd(moment.dot(moment), inverse, one);
      const V half = hn::Sqrt(hn::Mul(hn::Max(above, zero), inverse));
      const auto ahead = hn::Gt(half, hn::Mul(along, inverse));
      const auto hit = hn::And(hn::And(hn::Gt(above, zero), ahead), hn::FirstN(d, block.x1 - x));

      // Keep the rays that do.
      if (hn::AllFalse(d, hit)) continue;
      const bool all = hn::AllTrue(d, hit);
      const Point closest = direction.cross(moment).times(inverse);
      store_chosen(closest.plus(hn::Neg(half), direction), all, hit, rays.enter, n);
      store_chosen(closest.plus(half, direction), all, hit, rays.leave, n);
      store_chosen(hn::Iota(DU(), y * fan.width + x), all, hit, DU(), rays.pixel.data() + n);
      n += hn::CountTrue(d, hit);
    }
  }
  rays.count = n;
}

void find_entries_any(const LevelGeometry& geometry, const RayBlock& rays, bool nearest,
                      bool with_points, EntryArrays& entries) {
  const DI di;
  const std::int32_t resolution = geometry.entry_resolution();
  const auto* rows = reinterpret_cast<const std::int32_t*>(geometry.entry_rows().data());
  const auto row_bits = static_cast<int>(geometry.row_bits());
  const VI stride = hn::Set(di, resolution + 1), one = hn::Set(di, 1), zero = hn::Zero(di);
  const VI row_mask = hn::Set(di, (1 << row_bits) - 1);
  const VI columns = hn::Set(di, static_cast<std::int32_t>(triangle_size(geometry.exit_side())));
  const auto store_row = [&](VI vertex, V weight, std::size_t c, std::size_t k) {
    const VI packed = hn::GatherIndex(di, rows, vertex);
    store(hn::ShiftRightSame(packed, row_bits), entries.section[c], k);
    store(hn::Mul(hn::And(packed, row_mask), columns), entries.row[c], k);
    store(weight, entries.weight[c], k);
  };
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
      if (!nearest) store_row(corners[c], cell.weight[c], c, k);
      if (with_points)
        vertex(hn::Add(cell.x, x_step[c]), hn::Add(cell.y, y_step[c]), resolution, enter)
            .store_to(entries.point[c], k);
    }
    if (nearest) store_row(Nearest::of(cell.weight).choose_from(corners), hn::Set(D(), 1.f), 0, k);
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
    store(hn::Sub(first, down), exits.pair, k);
    store(mul_add(sign, line, first), exits.third, k);
    V weight[] = {cell.weight[0], cell.weight[1], cell.weight[2]};
    if (nearest) {
      const Nearest best = Nearest::of(weight);
      const V full = hn::Set(d, 1.f);
      weight[2] = hn::IfThenElseZero(best.third, full);
      weight[1] = hn::IfThenZeroElse(best.third, hn::IfThenElseZero(best.second, full));
      weight[0] = hn::Sub(full, hn::Add(weight[1], weight[2]));
    }
    // The lower column of the pair comes first.
    const auto swap = hn::RebindMask(d, hn::Eq(down, one));
    store(hn::IfThenElse(swap, weight[1], weight[0]), exits.weight[0], k);
    store(hn::IfThenElse(swap, weight[0], weight[1]), exits.weight[1], k);
    store(weight[2], exits.weight[2], k);
  }
}

void keep_moving_any(float rest, RayBlock& rays, EntryArrays& entries, float* t) {
  const D d;
  std::size_t n = 0;
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const auto moving = hn::And(hn::Gt(hn::LoadU(d, &entries.step[k]), hn::Set(d, rest)),
                                hn::FirstN(d, rays.count - k));
    if (hn::AllFalse(d, moving)) continue;
    const bool all = hn::AllTrue(d, moving);
    store_chosen(Point::load(rays.enter, k), all, moving, rays.enter, n);
    store_chosen(Point::load(rays.leave, k), all, moving, rays.leave, n);
    store_chosen(hn::LoadU(DU(), &rays.pixel[k]), all, moving, DU(), &rays.pixel[n]);
    for (auto& aim : entries.t) store_chosen(hn::LoadU(d, &aim[k]), all, moving, d, &aim[n]);
    store_chosen(hn::LoadU(d, t + k), all, moving, d, t + n);
    n += hn::CountTrue(d, moving);
  }
  rays.count = n;
}

void aim_at_depth_any(const RayBlock& rays, const EntryArrays& entries,
                      std::array<PointArrays, 3>& aims) {
  const D d;
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const Point enter = Point::load(rays.enter, k);
    const Point ray = Point::load(rays.leave, k).minus(enter);
    for (std::size_t c = 0; c < 3; ++c) {
      const Point seen = enter.plus(hn::LoadU(d, &entries.t[c][k]), ray);
      const Point from = Point::load(entries.point[c], k);
      const Point along = seen.minus(from);
      const V length2 = along.dot(along);
      const V far = hn::Div(hn::Mul(hn::Set(d, -2.f), from.dot(along)), length2);
      from.plus(hn::IfThenElseZero(hn::Gt(length2, hn::Zero(d)), far), along).store_to(aims[c], k);
    }
  }
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
HWY_EXPORT(keep_moving_any);
HWY_EXPORT(aim_at_depth_any);

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

void keep_moving(float rest, RayBlock& rays, EntryArrays& entries, float* t) {
  HWY_DYNAMIC_DISPATCH(keep_moving_any)(rest, rays, entries, t);
}

void aim_at_depth(const RayBlock& rays, const EntryArrays& entries,
                  std::array<PointArrays, 3>& aims) {
  HWY_DYNAMIC_DISPATCH(aim_at_depth_any)(rays, entries, aims);
}

}  // namespace slf
#endif  // HWY_ONCE
