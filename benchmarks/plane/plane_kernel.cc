#include "benchmarks/plane/plane_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "benchmarks/plane/plane_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "field/render/render_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf::bench {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using slf::HWY_NAMESPACE::byte_of;
using slf::HWY_NAMESPACE::D;
using slf::HWY_NAMESPACE::DI;
using slf::HWY_NAMESPACE::DU;
using slf::HWY_NAMESPACE::PixelSquare;
using slf::HWY_NAMESPACE::to_int;
using slf::HWY_NAMESPACE::V;
using slf::HWY_NAMESPACE::VI;
using slf::HWY_NAMESPACE::VU;
using M = hn::Mask<D>;

HWY_INLINE V set(float v) { return hn::Set(D(), v); }
HWY_INLINE VI set_int(std::int32_t v) { return hn::Set(DI(), v); }

/// One of three by axis: a where `is_x`, b where `is_y`, else c.
HWY_INLINE V by_axis(M is_x, M is_y, V a, V b, V c) {
  return hn::IfThenElse(is_x, a, hn::IfThenElse(is_y, b, c));
}

/// A position along one axis of a plane's grid: the node below it, and the fraction of a cell.
struct Place {
  VI node;
  V part;
};
HWY_INLINE Place place(V x, double height, std::int32_t nodes) {
  const auto scale = static_cast<float>((nodes - 1) / (2 * PlaneShape::extent(height)));
  const V at = hn::MulAdd(x, set(scale), set(0.5f * static_cast<float>(nodes - 1)));
  const V last = set(static_cast<float>(nodes - 2));
  const V node = hn::Min(hn::Max(hn::Floor(at), hn::Zero(D())), last);
  const V part = hn::Sub(at, node);
  return {to_int(node), hn::Min(hn::Max(part, hn::Zero(D())), set(1.f))};
}

HWY_INLINE void store_chosen(VI v, M hit, std::vector<std::uint32_t>& to, std::size_t n) {
  const auto packed = hn::Compress(v, hn::RebindMask(DI(), hit));
  hn::StoreU(hn::BitCast(DU(), packed), DU(), to.data() + n);
}

void locate_samples_any(const PlaneShape& shape, const PlaneBasis& basis, std::uint32_t x0,
                        std::uint32_t x1, std::uint32_t y0, std::uint32_t y1, PlaneRays& rays) {
  const D d;
  const DI di;
  const TileGrid grid(shape);
  const V zero = hn::Zero(d);
  const V x_end = set(static_cast<float>(x1)), y_end = set(static_cast<float>(y1));
  const V eye[] = {set(basis.eye.x), set(basis.eye.y), set(basis.eye.z)};
  const V eye_beyond = set(glm::dot(basis.eye, basis.eye) - 1);
  const VI row_blocks = set_int(grid.row_blocks), column_blocks = set_int(grid.column_blocks);
  const VI columns_blocks2 = hn::Mul(column_blocks, column_blocks);
  const VI in_block = set_int(kRowEdge - 1), one = set_int(1);
  const PixelSquare square(basis.width);
  std::size_t n = 0;
  for (std::uint32_t y = y0; y < y1; y += PixelSquare::kDown) {
    const V row = hn::Add(square.down, set(static_cast<float>(y) + 0.5f));
    const auto start = [&](float corner, float down) {
      return hn::MulAdd(row, set(down), set(corner));
    };
    const V starts[] = {start(basis.corner.x, basis.down.x), start(basis.corner.y, basis.down.y),
                        start(basis.corner.z, basis.down.z)};
    for (std::uint32_t x = x0; x < x1; x += PixelSquare::kAcross) {
      const V column = hn::Add(square.right, set(static_cast<float>(x) + 0.5f));
      const V dir[] = {hn::MulAdd(column, set(basis.across.x), starts[0]),
                       hn::MulAdd(column, set(basis.across.y), starts[1]),
                       hn::MulAdd(column, set(basis.across.z), starts[2])};

      // Keep the rays that cross the sphere, ahead of the eye.
      const V length2 =
          hn::MulAdd(dir[0], dir[0], hn::MulAdd(dir[1], dir[1], hn::Mul(dir[2], dir[2])));
      const V toward =
          hn::MulAdd(eye[0], dir[0], hn::MulAdd(eye[1], dir[1], hn::Mul(eye[2], dir[2])));
      const V inside = hn::Sub(hn::Mul(toward, toward), hn::Mul(length2, eye_beyond));
      const M pixel = hn::And(hn::Lt(column, x_end), hn::Lt(row, y_end));
      const M hit = hn::And(hn::And(hn::Gt(inside, zero), hn::Lt(toward, zero)), pixel);
      if (hn::AllFalse(d, hit)) continue;

      // Choose the pair of planes by the greatest component, and go to its frame.
      const V ax = hn::Abs(dir[0]), ay = hn::Abs(dir[1]), az = hn::Abs(dir[2]);
      const M is_x = hn::And(hn::Ge(ax, ay), hn::Ge(ax, az));
      const M is_y = hn::AndNot(is_x, hn::Ge(ay, az));
      const V along = by_axis(is_x, is_y, dir[0], dir[1], dir[2]);
      const M down = hn::Lt(along, zero);
      const V inverse = hn::Div(set(1.f), hn::Abs(along));
      const V slope_x = hn::Mul(by_axis(is_x, is_y, dir[1], dir[2], dir[0]), inverse);
      const V slope_y = hn::Mul(by_axis(is_x, is_y, dir[2], dir[0], dir[1]), inverse);
      const V from_x = by_axis(is_x, is_y, eye[1], eye[2], eye[0]);
      const V from_y = by_axis(is_x, is_y, eye[2], eye[0], eye[1]);
      const V height = by_axis(is_x, is_y, eye[0], eye[1], eye[2]);
      const V from_z = hn::IfThenElse(down, hn::Neg(height), height);
      const VI axis = hn::IfThenElseZero(hn::RebindMask(di, hn::Not(is_x)),
                                         hn::IfThenElse(hn::RebindMask(di, is_y), one, set_int(2)));
      const VI pair =
          hn::Add(hn::Add(axis, axis), hn::IfThenElseZero(hn::RebindMask(di, down), one));

      // Cross both planes.
      const V to_first = hn::Sub(set(static_cast<float>(shape.first)), from_z);
      const V to_second = hn::Sub(set(static_cast<float>(shape.second)), from_z);
      const Place u = place(hn::MulAdd(to_first, slope_x, from_x), shape.first, shape.first_nodes);
      const Place v = place(hn::MulAdd(to_first, slope_y, from_y), shape.first, shape.first_nodes);
      const Place s =
          place(hn::MulAdd(to_second, slope_x, from_x), shape.second, shape.second_nodes);
      const Place t =
          place(hn::MulAdd(to_second, slope_y, from_y), shape.second, shape.second_nodes);

      // Find the tile and row of each corner of the uv cell, and the column of the st cell.
      const VI sb = hn::ShiftRight<kColumnShift>(s.node), tb = hn::ShiftRight<kColumnShift>(t.node);
      const VI column_block = hn::Add(hn::Mul(tb, column_blocks), sb);
      const VI sc = hn::Sub(s.node, hn::ShiftLeft<kColumnShift>(sb));
      const VI tc = hn::Sub(t.node, hn::ShiftLeft<kColumnShift>(tb));
      store_chosen(hn::Add(hn::Mul(tc, set_int(kColumnEdge)), sc), hit, rays.column, n);
      const VI first_block = hn::Mul(pair, row_blocks);
      for (std::size_t c = 0; c < 4; ++c) {
        const VI un = c & 1 ? hn::Add(u.node, one) : u.node;
        const VI vn = c & 2 ? hn::Add(v.node, one) : v.node;
        const VI block_row = hn::Add(first_block, hn::ShiftRight<kRowShift>(vn));
        const VI block = hn::Add(hn::Mul(block_row, row_blocks), hn::ShiftRight<kRowShift>(un));
        store_chosen(hn::Add(hn::Mul(block, columns_blocks2), column_block), hit, rays.tile[c], n);
        const VI in_tile =
            hn::Add(hn::ShiftLeft<kRowShift>(hn::And(vn, in_block)), hn::And(un, in_block));
        store_chosen(hn::Mul(in_tile, set_int(kTileColumns)), hit, rays.row[c], n);
      }
      const V parts[] = {u.part, v.part, s.part, t.part};
      for (std::size_t p = 0; p < 4; ++p)
        hn::StoreU(hn::Compress(parts[p], hit), d, rays.part[p].data() + n);
      const VU first = hn::Set(DU(), y * basis.width + x);
      store_chosen(hn::BitCast(di, hn::Add(first, square.index)), hit, rays.pixel, n);
      n += hn::CountTrue(d, hit);
    }
  }
  rays.count = n;
}

HWY_INLINE void add_sample(VI v, V weight, V sum[4]) {
  const VU bytes = hn::BitCast(DU(), v);
  sum[0] = hn::MulAdd(weight, byte_of<0>(bytes), sum[0]);
  sum[1] = hn::MulAdd(weight, byte_of<1>(bytes), sum[1]);
  sum[2] = hn::MulAdd(weight, byte_of<2>(bytes), sum[2]);
  sum[3] = hn::MulAdd(weight, byte_of<3>(bytes), sum[3]);
}

/// The four samples of each lane's st cell, whose first is at `at`.
HWY_INLINE void gather_cell(const std::uint32_t* samples, VI at, VI cell[4]) {
  const DI di;
#if HWY_TARGET == HWY_SCALAR
  const auto* base = reinterpret_cast<const std::int32_t*>(samples);
  const int steps[] = {0, 1, kColumnEdge, kColumnEdge + 1};
  for (int e = 0; e < 4; ++e) cell[e] = hn::GatherIndex(di, base, hn::Add(at, set_int(steps[e])));
#else
  // Two columns side by side with one load, of the lower half of the lanes and of the upper.
  const hn::Repartition<std::int64_t, D> d64;
  const hn::Half<DI> half;
  const auto* base = reinterpret_cast<const std::int64_t*>(samples);
  auto low = hn::ShiftLeft<2>(hn::PromoteTo(d64, hn::LowerHalf(half, at)));
  auto high = hn::ShiftLeft<2>(hn::PromoteTo(d64, hn::UpperHalf(half, at)));
  for (int row = 0; row < 4; row += 2) {
    const VI first = hn::BitCast(di, hn::GatherOffset(d64, base, low));
    const VI second = hn::BitCast(di, hn::GatherOffset(d64, base, high));
    cell[row] = hn::ConcatEven(di, second, first);
    cell[row + 1] = hn::ConcatOdd(di, second, first);
    low = hn::Add(low, hn::Set(d64, 4 * kColumnEdge));
    high = hn::Add(high, hn::Set(d64, 4 * kColumnEdge));
  }
#endif
}

void blend_any(const PlaneRays& rays, const std::uint32_t* tiles, const std::uint32_t* samples,
               glm::vec4* rgba) {
  const D d;
  const DI di;
  const V one = set(1.f), unit = set(1.f / 255);
  const auto load = [&](const std::vector<std::uint32_t>& from, std::size_t k, hn::Mask<DI> in) {
    return hn::IfThenElseZero(in, hn::BitCast(di, hn::LoadU(DU(), from.data() + k)));
  };
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const auto in = hn::FirstN(di, rays.count - k);  // values after the last ray are no addresses
    V high[4], low[4];
    for (std::size_t p = 0; p < 4; ++p) {
      high[p] = hn::LoadU(d, rays.part[p].data() + k);
      low[p] = hn::Sub(one, high[p]);
    }
    const V exit[] = {hn::Mul(low[2], low[3]), hn::Mul(high[2], low[3]), hn::Mul(low[2], high[3]),
                      hn::Mul(high[2], high[3])};
    const VI column = load(rays.column, k, in);
    V sum[4] = {hn::Zero(d), hn::Zero(d), hn::Zero(d), hn::Zero(d)};
    for (std::size_t c = 0; c < 4; ++c) {
      const V entry = hn::Mul(c & 1 ? high[0] : low[0], c & 2 ? high[1] : low[1]);
      const VI number = load(rays.tile[c], k, in);
      // Often all rays of a vector need one tile, as on the sphere.
      const std::uint32_t first = rays.tile[c][k];
      const VI one_number = set_int(static_cast<std::int32_t>(first));
      const VI tile =
          hn::AllFalse(di, hn::AndNot(hn::Eq(number, one_number), in))
              ? set_int(static_cast<std::int32_t>(tiles[first]))
              : hn::IfThenElseZero(
                    in, hn::GatherIndex(di, reinterpret_cast<const std::int32_t*>(tiles), number));
      const VI at =
          hn::Add(hn::Mul(tile, set_int(kTileSamples)), hn::Add(load(rays.row[c], k, in), column));
      VI cell[4];
      gather_cell(samples, at, cell);
      for (std::size_t e = 0; e < 4; ++e) add_sample(cell[e], hn::Mul(entry, exit[e]), sum);
    }
    hn::StoreInterleaved4(hn::Mul(sum[0], unit), hn::Mul(sum[1], unit), hn::Mul(sum[2], unit),
                          hn::Mul(sum[3], unit), d, &rgba[k].x);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf::bench
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf::bench {

HWY_EXPORT(locate_samples_any);
HWY_EXPORT(blend_any);

void PlaneRays::resize(std::size_t size) {
  const std::size_t padded = size + kPadding;
  pixel.resize(padded);
  column.resize(padded);
  for (auto& array : tile) array.resize(padded);
  for (auto& array : row) array.resize(padded);
  for (auto& array : part) array.resize(padded);
}

void locate_samples(const PlaneShape& shape, const PlaneBasis& basis, std::uint32_t x0,
                    std::uint32_t x1, std::uint32_t y0, std::uint32_t y1, PlaneRays& rays) {
  HWY_DYNAMIC_DISPATCH(locate_samples_any)(shape, basis, x0, x1, y0, y1, rays);
}

void blend(const PlaneRays& rays, const std::uint32_t* tiles, const std::uint32_t* samples,
           glm::vec4* rgba) {
  HWY_DYNAMIC_DISPATCH(blend_any)(rays, tiles, samples, rgba);
}

}  // namespace slf::bench
#endif  // HWY_ONCE
