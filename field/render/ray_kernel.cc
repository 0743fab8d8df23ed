#include "field/render/ray_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/render/ray_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include "field/geometry/cells-inl.h"
#include "field/render/render_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

/// Which of three weights is the greatest.
struct Nearest {
  hn::Mask<D> second, third;

  static HWY_INLINE Nearest of(const V weight[3]) {
    return {hn::Gt(weight[1], weight[0]), hn::Gt(weight[2], hn::Max(weight[0], weight[1]))};
  }
  template <class T>
  HWY_INLINE T choose_from(const T v[3]) const {
    return choose(third, v[2], choose(second, v[1], v[0]));
  }
};

/// The unit direction of a lattice point, on the side of each axis that `side` is on.
HWY_INLINE Point vertex(V x, V y, std::int32_t resolution, const Point& side) {
  const V whole = hn::Set(D(), static_cast<float>(resolution));
  const Point p{x, y, hn::Sub(hn::Sub(whole, x), y)};
  const V inverse = hn::Div(hn::Set(D(), 1.f), hn::Sqrt(p.dot(p)));
  return {hn::CopySign(hn::Mul(p.x, inverse), side.x), hn::CopySign(hn::Mul(p.y, inverse), side.y),
          hn::CopySign(hn::Mul(p.z, inverse), side.z)};
}

/// A vector that is linear in the pixel's position: its value at a block's first pixel, and its
/// differences per pixel to the right and down. The start is computed in double, because eyes may
/// be far away; for the few steps within a block, float is precise enough.
struct Linear {
  Point start, across, down;

  HWY_INLINE Point at(V x, V y) const { return start.plus(x, across).plus(y, down); }
};

void cast_rays_any(const CameraBasis& basis, const PixelBlock& block, RayBlock& rays) {
  const D d;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f);
  const glm::dvec3 start =
      basis.corner + (block.x0 + 0.5) * basis.across + (block.y0 + 0.5) * basis.down;
  const auto linear = [&](const auto& of) {
    return Linear{Point::set(of(start)), Point::set(of(basis.across)), Point::set(of(basis.down))};
  };
  const Linear directions = linear([](const glm::dvec3& v) { return v; });
  // The moment eye × direction leads to the ray's point closest to the centre: direction × moment
  // over the squared length of direction.
  const Linear moments = linear([&](const glm::dvec3& v) { return glm::cross(basis.eye, v); });
  const auto along_eye = [&](const glm::dvec3& v) {
    return hn::Set(d, static_cast<float>(glm::dot(basis.eye, v)));
  };
  const V along_start = along_eye(start), along_across = along_eye(basis.across),
          along_down = along_eye(basis.down);
  const PixelSquare square(basis.width);
  const auto count = [&](std::uint32_t pixels) { return hn::Set(d, static_cast<float>(pixels)); };
  const V columns = count(block.x1 - block.x0), rows = count(block.y1 - block.y0);
  std::size_t n = 0;
  for (std::uint32_t y = block.y0; y < block.y1; y += PixelSquare::kDown) {
    const V row = hn::Add(square.down, count(y - block.y0));
    for (std::uint32_t x = block.x0; x < block.x1; x += PixelSquare::kAcross) {
      const V column = hn::Add(square.right, count(x - block.x0));
      const Point direction = directions.at(column, row);
      const Point moment = moments.at(column, row);
      const V along = hn::MulAdd(row, along_down, hn::MulAdd(column, along_across, along_start));

      // Find the ray's point closest to the centre, and half the chord around it.
      const V inverse = hn::Div(one, direction.dot(direction));
      const V above = hn::NegMulAdd(moment.dot(moment), inverse, one);
      const V half = hn::Sqrt(hn::Mul(hn::Max(above, zero), inverse));
      const auto ahead = hn::Gt(half, hn::Mul(along, inverse));
      const auto inside = hn::And(hn::Lt(column, columns), hn::Lt(row, rows));
      const auto hit = hn::And(hn::And(hn::Gt(above, zero), ahead), inside);

      // Keep the rays that cross the sphere ahead of the eye.
      if (hn::AllFalse(d, hit)) continue;
      const bool all = hn::AllTrue(d, hit);
      const Point closest = direction.cross(moment).times(inverse);
      store_chosen(closest.plus(hn::Neg(half), direction), all, hit, rays.enter, n);
      store_chosen(closest.plus(half, direction), all, hit, rays.leave, n);
      const VU first = hn::Set(DU(), y * basis.width + x);
      store_chosen(hn::Add(first, square.index), all, hit, DU(), rays.pixel.data() + n);
      n += hn::CountTrue(d, hit);
    }
  }
  rays.count = n;
}

void locate_entries_any(const LevelGeometry& geometry, const RayBlock& rays, bool nearest,
                        bool with_points, EntryCells& entries) {
  const D d;
  const DI di;
  const std::int32_t resolution = geometry.entry_resolution(), across = resolution + 1;
  const auto* rows = reinterpret_cast<const std::int32_t*>(geometry.entry_rows().data());
  const auto row_bits = static_cast<int>(geometry.row_bits());
  const VI stride = hn::Set(di, across), one = hn::Set(di, 1);
  const VI row_mask = hn::Set(di, (1 << row_bits) - 1);
  const VI columns = hn::Set(di, static_cast<std::int32_t>(triangle_size(geometry.exit_side())));
  const auto store_row = [&](VI vertex, V weight, std::size_t c, std::size_t k) {
    const VI packed = hn::GatherIndex(di, rows, vertex);
    store(hn::ShiftRightSame(packed, row_bits), entries.section[c], k);
    store(hn::Mul(hn::And(packed, row_mask), columns), entries.row_begin[c], k);
    store(weight, entries.weight[c], k);
  };
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const Point enter = Point::load(rays.enter, k);
    const Cells cell = locate_cells<1>(enter, resolution, across * across);
    // The corners, as in Cell::corners().
    const VI base = hn::Add(mul_add(to_int(cell.y), stride, to_int(cell.x)), cell.octant);
    const VI corners[] = {hn::Add(base, flag(cell.inverted, across + 1)),
                          hn::Add(base, choose(cell.inverted, stride, one)),
                          hn::Add(base, choose(cell.inverted, one, stride))};
    const Nearest best = Nearest::of(cell.weight);
    if (nearest)
      store_row(best.choose_from(corners), hn::Set(d, 1.f), 0, k);
    else
      for (std::size_t c = 0; c < 3; ++c) store_row(corners[c], cell.weight[c], c, k);
    if (!with_points) continue;
    const V x1 = hn::Add(cell.x, hn::Set(d, 1.f)), y1 = hn::Add(cell.y, hn::Set(d, 1.f));
    const V x[] = {hn::IfThenElse(cell.inverted, x1, cell.x),
                   hn::IfThenElse(cell.inverted, cell.x, x1),
                   hn::IfThenElse(cell.inverted, x1, cell.x)};
    const V y[] = {hn::IfThenElse(cell.inverted, y1, cell.y),
                   hn::IfThenElse(cell.inverted, y1, cell.y),
                   hn::IfThenElse(cell.inverted, cell.y, y1)};
    const auto store_point = [&](V at_x, V at_y, std::size_t c) {
      vertex(at_x, at_y, resolution, enter).store_to(entries.point[c], k);
    };
    if (nearest)
      store_point(best.choose_from(x), best.choose_from(y), 0);
    else
      for (std::size_t c = 0; c < 3; ++c) store_point(x[c], y[c], c);
  }
}

void locate_exits_any(const LevelGeometry& geometry, const PointArrays& points, std::size_t count,
                      ExitUse use, ExitCells& exits) {
  const D d;
  const ExitFinder finder(geometry);
  const V n = hn::Set(d, static_cast<float>(geometry.exit_side())), one = hn::Set(d, 1.f);
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    const Cells cell = finder.cells<1>(Point::load(points, k));
    const ExitPlaces at = finder.places(cell);
    const V back = hn::IfThenElseZero(at.down, one);
    store(at.section, exits.section, k);
    store(to_int(hn::Sub(at.first, back)), exits.pair, k);
    store(to_int(at.third), exits.third, k);
    V weight[] = {cell.weight[0], cell.weight[1], cell.weight[2]};
    if (use == ExitUse::nearest) {
      const Nearest best = Nearest::of(weight);
      weight[2] = hn::IfThenElseZero(best.third, one);
      weight[1] = hn::IfThenZeroElse(best.third, hn::IfThenElseZero(best.second, one));
      weight[0] = hn::Sub(one, hn::Add(weight[1], weight[2]));
    }
    if (use == ExitUse::cubic) {
      // The pair's local coordinates are (a, q) and (a + 1, q), those of the third (p, q ± 1).
      const V p = at.p, q = at.q, a = hn::Sub(p, back), two = hn::Add(one, one);
      const V up = hn::NegMulAdd(two, back, one);
      const V below = hn::Sub(q, up), above = hn::MulAdd(two, up, q);
      const V from_third = hn::Sub(hn::Add(a, a), p), to_third = hn::Sub(hn::Add(p, p), a);
      const auto store_next = [&](std::size_t pair, V at_p, V at_q) {
        const auto inside =
            hn::Ge(hn::Min(hn::Min(at_p, at_q), hn::Sub(n, hn::Add(at_p, at_q))), hn::Zero(d));
        const VI next = to_int(hn::IfThenElseZero(inside, finder.column(at_p, at_q)));
        store(choose(inside, next, hn::Set(DI(), static_cast<std::int32_t>(kOutside))),
              exits.next[pair], k);
      };
      store_next(0, hn::Sub(a, one), q);  // in the order of kVertexPairs
      store_next(1, hn::Add(a, two), q);
      store_next(2, from_third, below);
      store_next(3, to_third, above);
      store_next(4, hn::Add(from_third, two), below);
      store_next(5, hn::Sub(to_third, one), above);
    }
    // The lower column of the pair comes first.
    store(hn::IfThenElse(at.down, weight[1], weight[0]), exits.weight[0], k);
    store(hn::IfThenElse(at.down, weight[0], weight[1]), exits.weight[1], k);
    store(weight[2], exits.weight[2], k);
  }
}

/// Appends the chosen rays of those from `k` on, with these aims. The destination may begin at or
/// before the source.
HWY_INLINE void append(const RayBlock& rays, const DepthEstimates& estimates,
                       const std::array<RayArray<float>, 3>& aims, std::size_t k,
                       hn::Mask<D> chosen, std::size_t& n, RayBlock& to_rays,
                       DepthEstimates& to_estimates) {
  const D d;
  const bool all = hn::AllTrue(d, chosen);
  store_chosen(Point::load(rays.enter, k), all, chosen, to_rays.enter, n);
  store_chosen(Point::load(rays.leave, k), all, chosen, to_rays.leave, n);
  store_chosen(hn::LoadU(DU(), &rays.pixel[k]), all, chosen, DU(), &to_rays.pixel[n]);
  for (std::size_t c = 0; c < 3; ++c)
    store_chosen(hn::LoadU(d, &aims[c][k]), all, chosen, d, &to_estimates.aim[c][n]);
  store_chosen(hn::LoadU(d, &estimates.t[k]), all, chosen, d, &to_estimates.t[n]);
  n += hn::CountTrue(d, chosen);
}

void separate_rays_any(float threshold, float contrast, RayBlock& rays, DepthEstimates& estimates,
                       RayBlock& contrast_rays, DepthEstimates& contrast_estimates) {
  const D d;
  std::size_t n = 0;
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const auto valid = hn::FirstN(d, rays.count - k);
    const auto moving = hn::Gt(hn::LoadU(d, &estimates.step[k]), hn::Set(d, threshold));
    const auto contrasts = hn::Ge(hn::LoadU(d, &estimates.contrast[k]), hn::Set(d, contrast));
    const auto unconverged = hn::And(moving, valid);
    const auto ended = hn::AndNot(moving, hn::And(contrasts, valid));
    if (!hn::AllFalse(d, ended))
      append(rays, estimates, estimates.aim, k, ended, contrast_rays.count, contrast_rays,
             contrast_estimates);
    if (!hn::AllFalse(d, unconverged))
      append(rays, estimates, estimates.next, k, unconverged, n, rays, estimates);
  }
  rays.count = n;
}

void aim_at_depth_any(const RayBlock& rays, const EntryCells& entries,
                      const DepthEstimates& estimates, std::array<PointArrays, 3>& exits) {
  const D d;
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const Point enter = Point::load(rays.enter, k);
    const Point ray = Point::load(rays.leave, k).minus(enter);
    for (std::size_t c = 0; c < 3; ++c) {
      const Point target = enter.plus(hn::LoadU(d, &estimates.aim[c][k]), ray);
      const Point from = Point::load(entries.point[c], k);
      const Point along = target.minus(from);
      const V length2 = along.dot(along);
      const V far = hn::Div(hn::Mul(hn::Set(d, -2.f), from.dot(along)), length2);
      from.plus(hn::IfThenElseZero(hn::Gt(length2, hn::Zero(d)), far), along).store_to(exits[c], k);
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
HWY_EXPORT(locate_entries_any);
HWY_EXPORT(locate_exits_any);
HWY_EXPORT(separate_rays_any);
HWY_EXPORT(aim_at_depth_any);

void cast_rays(const CameraBasis& basis, const PixelBlock& block, RayBlock& rays) {
  HWY_DYNAMIC_DISPATCH(cast_rays_any)(basis, block, rays);
}

void locate_entries(const LevelGeometry& geometry, const RayBlock& rays, bool nearest,
                    bool with_points, EntryCells& entries) {
  HWY_DYNAMIC_DISPATCH(locate_entries_any)
  (geometry, rays, nearest, with_points, entries);
}

void locate_exits(const LevelGeometry& geometry, const PointArrays& points, std::size_t count,
                  ExitUse use, ExitCells& exits) {
  HWY_DYNAMIC_DISPATCH(locate_exits_any)
  (geometry, points, count, use, exits);
}

void separate_rays(float threshold, float contrast, RayBlock& rays, DepthEstimates& estimates,
                   RayBlock& contrast_rays, DepthEstimates& contrast_estimates) {
  HWY_DYNAMIC_DISPATCH(separate_rays_any)
  (threshold, contrast, rays, estimates, contrast_rays, contrast_estimates);
}

void aim_at_depth(const RayBlock& rays, const EntryCells& entries, const DepthEstimates& estimates,
                  std::array<PointArrays, 3>& exits) {
  HWY_DYNAMIC_DISPATCH(aim_at_depth_any)(rays, entries, estimates, exits);
}

}  // namespace slf
#endif  // HWY_ONCE
