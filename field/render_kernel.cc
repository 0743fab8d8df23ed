#include "field/render_kernel.h"

#include <algorithm>
#include <type_traits>

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
using D64 = hn::ScalableTag<std::int64_t>;
using V = hn::Vec<D>;
using VI = hn::Vec<DI>;
using VU = hn::Vec<DU>;
using V64 = hn::Vec<D64>;

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
HWY_INLINE void store(VI v, RayArray<std::uint32_t>& to, std::size_t k) {
  hn::StoreU(hn::BitCast(DU(), v), DU(), to.data() + k);
}
HWY_INLINE void store(V v, RayArray<float>& to, std::size_t k) {
  hn::StoreU(v, D(), to.data() + k);
}

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

/// The numbers of tiles as far as they were asked for recently; of others, kNoTile.
HWY_INLINE VU recent_numbers(const TileNumbers::Recent& recent, VU entry, VU exit) {
  const DU d;
  const VU hash = hn::Add(hn::Mul(entry, hn::Set(d, TileNumbers::Recent::kEntryFactor)),
                          hn::Mul(exit, hn::Set(d, TileNumbers::Recent::kExitFactor)));
  const VI slot = hn::BitCast(DI(), hn::ShiftRight<TileNumbers::Recent::kShift>(hash));
  const auto same = hn::And(hn::Eq(hn::GatherIndex(d, recent.entry.data(), slot), entry),
                            hn::Eq(hn::GatherIndex(d, recent.exit.data(), slot), exit));
  return hn::IfThenElse(same, hn::GatherIndex(d, recent.number.data(), slot), hn::Set(d, kNoTile));
}

void number_tiles_any(const Pass& pass, const EntryArrays& entries, std::size_t count,
                      TileNumbers& numbers, TileArrays& tiles) {
  const DU d;
  const VU no_tile = hn::Set(d, kNoTile);
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    VU tile = no_tile, last_entry = no_tile, last_exit = no_tile;  // of the slot before
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const VU entry = hn::LoadU(d, &entries.section[c][k]);
      const VU exit = hn::LoadU(d, &pass.exit[c]->section[k]);
      const auto used =
          hn::And(hn::RebindMask(d, hn::Gt(hn::LoadU(D(), &entries.weight[c][k]), hn::Zero(D()))),
                  hn::FirstN(d, count - k));
      // Mostly a ray's entry slots share a tile.
      const auto as_before = hn::And(hn::Eq(entry, last_entry), hn::Eq(exit, last_exit));
      tile = hn::IfThenElse(hn::And(as_before, used), tile, no_tile);
      last_entry = entry, last_exit = exit;
      auto left = hn::And(used, hn::Eq(tile, no_tile));
      if (!hn::AllFalse(d, left)) {
        tile = hn::IfThenElse(left, recent_numbers(numbers.recent(), entry, exit), tile);
        left = hn::And(used, hn::Eq(tile, no_tile));
      }
      while (!hn::AllFalse(d, left)) {
        const auto lane = k + static_cast<std::size_t>(hn::FindFirstTrue(d, left));
        const TileNumbers::Pair pair{entries.section[c][lane], pass.exit[c]->section[lane]};
        const VU number = hn::Set(d, numbers.number(pair));
        const auto same =
            hn::And(hn::Eq(entry, hn::Set(d, pair.entry)), hn::Eq(exit, hn::Set(d, pair.exit)));
        tile = hn::IfThenElse(hn::And(same, left), number, tile);
        left = hn::AndNot(same, left);
      }
      hn::StoreU(tile, d, &tiles[c][k]);
    }
  }
}

using Narrow = hn::Rebind<std::uint32_t, D64>;  // as many lanes as D64 has

/// Vectors of 64-bit lanes that hold as many as one of 32.
constexpr std::size_t kHalves = HWY_TARGET == HWY_SCALAR ? 1 : 2;

/// The lower 32 bits of all lanes.
HWY_INLINE VU lower_bits(const V64 v[kHalves]) {
#if HWY_TARGET == HWY_SCALAR
  return hn::TruncateTo(DU(), hn::BitCast(hn::RebindToUnsigned<D64>(), v[0]));
#else
  return hn::ConcatEven(DU(), hn::BitCast(DU(), v[1]), hn::BitCast(DU(), v[0]));
#endif
}

/// The upper 32 bits of all lanes.
HWY_INLINE VU upper_bits(const V64 v[kHalves]) {
#if HWY_TARGET == HWY_SCALAR
  const V64 shifted = hn::ShiftRight<32>(v[0]);
  return lower_bits(&shifted);
#else
  return hn::ConcatOdd(DU(), hn::BitCast(DU(), v[1]), hn::BitCast(DU(), v[0]));
#endif
}

HWY_INLINE V64 widen(hn::Vec<Narrow> v) {
  return hn::BitCast(D64(), hn::PromoteTo(hn::RebindToUnsigned<D64>(), v));
}

/// Loads 8 bytes for each lane.
HWY_INLINE V64 load_at(const std::byte* base, V64 offset) {
  return hn::GatherOffset(D64(), reinterpret_cast<const std::int64_t*>(base), offset);
}

/// Where each lane's row begins, `row` bytes into its tile; without a tile, the row of zeros.
HWY_INLINE V64 find_rows(const std::vector<std::int64_t>& offsets, hn::Vec<Narrow> tile,
                         const std::uint32_t* one_tile, V64 row) {
  const D64 d;
  const V64 offset =
      one_tile ? hn::Set(d, offsets[*one_tile]) : hn::GatherIndex(d, offsets.data(), widen(tile));
  return hn::Add(offset, hn::IfThenZeroElse(hn::Eq(offset, hn::Zero(d)), row));
}

/// Depths at a column of each row and the columns that follow, a byte each, lowest first. `last` is
/// the last column that 8 bytes can be loaded at.
HWY_INLINE V64 load_depths(const std::byte* base, V64 row, hn::Vec<Narrow> column,
                           hn::Vec<Narrow> last) {
  const auto at = hn::Min(column, last);
  const V64 bits = hn::ShiftLeft<3>(widen(hn::Sub(column, at)));
  const hn::RebindToUnsigned<D64> d;
  return hn::BitCast(
      D64(), hn::BitCast(d, load_at(base, hn::Add(row, widen(at)))) >> hn::BitCast(d, bits));
}

template <bool kHalf, bool kDepth>
void take_typed(const TileOffsets& offsets, const Pass& pass, const EntryArrays& entries,
                const TileArrays& tiles, std::size_t count, std::uint32_t columns, bool add,
                SampleArrays& samples) {
  const D64 d;
  const Narrow narrow;
  const DU du;
  const std::size_t lanes = hn::Lanes(d);
  const auto absent = static_cast<std::uint32_t>(offsets.color.size() - 1);
  const auto last_load = hn::Set(narrow, columns < 8 ? 0 : columns - 8);
  const auto store_or = [&](auto v, auto tag, auto* to) {
    hn::StoreU(add ? hn::Or(v, hn::LoadU(tag, to)) : v, tag, to);
  };
  for (std::size_t c = 0; c < pass.entries; ++c) {
    const ExitArrays& exit = *pass.exit[c];
    for (std::size_t k = 0; k < count; k += kHalves * lanes) {
      const std::uint32_t first = std::min(tiles[c][k], absent);
      const VU all = hn::Min(hn::LoadU(du, &tiles[c][k]), hn::Set(du, absent));
      const auto* one_tile = hn::AllTrue(du, hn::Eq(all, hn::Set(du, first))) ? &first : nullptr;
      V64 colors[3][kHalves], depths[kHalves];
      for (std::size_t half = 0; half < kHalves; ++half) {
        const std::size_t at = k + half * lanes;
        const auto tile = hn::Min(hn::LoadU(narrow, &tiles[c][at]), hn::Set(narrow, absent));
        const V64 row = widen(hn::LoadU(narrow, &entries.row[c][at]));
        const auto pair = hn::LoadU(narrow, &exit.pair[at]);
        const auto third = hn::LoadU(narrow, &exit.third[at]);
        constexpr int kShift = kHalf ? 3 : 2;
        const V64 color_row = find_rows(offsets.color, tile, one_tile, hn::ShiftLeft<kShift>(row));
        const V64 pair_at = hn::Add(color_row, hn::ShiftLeft<kShift>(widen(pair)));
        const V64 third_at = hn::Add(color_row, hn::ShiftLeft<kShift>(widen(third)));
        colors[0][half] = load_at(offsets.zeros, pair_at);
        if constexpr (kHalf) {
          colors[1][half] = load_at(offsets.zeros, hn::Add(pair_at, hn::Set(d, 8)));
          colors[2][half] = load_at(offsets.zeros, third_at);
        } else {  // with the one before it: 8 bytes that are the tile's in any case
          colors[2][half] = load_at(offsets.zeros, hn::Sub(third_at, hn::Set(d, 4)));
        }
        if constexpr (kDepth) {
          const V64 depth_row = find_rows(offsets.depth, tile, one_tile, row);
          const V64 two = load_depths(offsets.zeros, depth_row, pair, last_load);
          const V64 one = load_depths(offsets.zeros, depth_row, third, last_load);
          depths[half] = hn::Or(hn::And(two, hn::Set(d, 0xFFFF)), hn::ShiftLeft<16>(one));
        }
      }
      if constexpr (kHalf) {
        for (std::size_t e = 0; e < 3; ++e)
          for (std::size_t half = 0; half < kHalves; ++half)
            store_or(hn::BitCast(hn::RebindToUnsigned<D64>(), colors[e][half]),
                     hn::RebindToUnsigned<D64>(), &samples.rgba16f[3 * c + e][k + half * lanes]);
      } else {
        store_or(lower_bits(colors[0]), du, &samples.rgba8[3 * c][k]);
        store_or(upper_bits(colors[0]), du, &samples.rgba8[3 * c + 1][k]);
        store_or(upper_bits(colors[2]), du, &samples.rgba8[3 * c + 2][k]);
      }
      if constexpr (kDepth) store_or(lower_bits(depths), du, &samples.depth[c][k]);
    }
  }
}

void take_samples_any(const TileOffsets& offsets, const Pass& pass, const EntryArrays& entries,
                      const TileArrays& tiles, std::size_t count, std::uint32_t columns,
                      bool half_floats, bool add, SampleArrays& samples) {
  const auto typed = half_floats
                         ? (pass.with_depth ? take_typed<true, true> : take_typed<true, false>)
                         : (pass.with_depth ? take_typed<false, true> : take_typed<false, false>);
  typed(offsets, pass, entries, tiles, count, columns, add, samples);
}

void aim_at_depth_any(const RayBlock& rays, const EntryArrays& entries,
                      const std::array<const float*, 3>& t, std::array<PointArrays, 3>& aims) {
  const D d;
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const Point enter = Point::load(rays.enter, k);
    const Point ray = Point::load(rays.leave, k).minus(enter);
    for (std::size_t c = 0; c < 3; ++c) {
      const Point seen = enter.plus(hn::LoadU(d, t[c] + k), ray);
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

HWY_INLINE V byte_of(VI v, int shift) {
  return to_float(hn::And(hn::ShiftRightSame(v, shift), hn::Set(DI(), 255)));
}

HWY_INLINE Colors load_colors(const RayArray<std::uint32_t>& from, std::size_t k) {
  const VI v = hn::BitCast(DI(), hn::LoadU(DU(), from.data() + k));
  return {byte_of(v, 0), byte_of(v, 8), byte_of(v, 16), byte_of(v, 24)};
}

HWY_INLINE Colors load_colors(const RayArray<std::uint64_t>& from, std::size_t k) {
  const hn::Rebind<std::uint16_t, D> bits;
  const hn::Rebind<hwy::float16_t, D> half;
  hn::Vec<decltype(bits)> r, g, b, a;
  hn::LoadInterleaved4(bits, reinterpret_cast<const std::uint16_t*>(from.data() + k), r, g, b, a);
  const auto to_float = [&](auto v) { return hn::PromoteTo(D(), hn::BitCast(half, v)); };
  return {to_float(r), to_float(g), to_float(b), to_float(a)};
}

template <bool kHalf, bool kDepth, bool kAims>
void blend_typed(const Pass& pass, const RayBlock& rays, EntryArrays& entries,
                 const SampleArrays& samples, glm::vec4* rgba, float* t) {
  const D d;
  const V zero = hn::Zero(d), unit = hn::Set(d, kHalf ? 1.f : 1.f / 255);
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    Colors sum{zero, zero, zero, zero};
    // Depth along the ray, times opacity and the ray's squared length.
    V place = zero, places[3], opacities[3];
    const Point enter = Point::load(rays.enter, k);
    const Point ray = Point::load(rays.leave, k).minus(enter);
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const V weight = hn::LoadU(d, entries.weight[c].data() + k);
      V opacity = zero, depth = zero;
      VI depths = hn::Zero(DI());
      if constexpr (kDepth)
        depths = hn::BitCast(DI(), hn::LoadU(DU(), samples.depth[c].data() + k));
      for (std::size_t e = 0; e < 3; ++e) {
        const V w = hn::Mul(weight, hn::LoadU(d, pass.exit[c]->weight[e].data() + k));
        const Colors v = kHalf ? load_colors(samples.rgba16f[3 * c + e], k)
                               : load_colors(samples.rgba8[3 * c + e], k);
        if constexpr (!kAims) {
          sum.r = hn::MulAdd(w, v.r, sum.r);
          sum.g = hn::MulAdd(w, v.g, sum.g);
          sum.b = hn::MulAdd(w, v.b, sum.b);
        }
        if constexpr (kDepth) {
          const V visible = hn::Mul(w, v.a);
          opacity = hn::Add(opacity, visible);
          depth = hn::MulAdd(visible, byte_of(depths, 8 * static_cast<int>(e)), depth);
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
        places[c] = hn::MulAdd(opacity, from.minus(enter).dot(ray), hn::Mul(share, along.dot(ray)));
        opacities[c] = opacity;
        place = hn::Add(place, places[c]);
      }
    }
    if constexpr (kDepth) {
      const V length2 = ray.dot(ray), one = hn::Set(d, 1.f);
      const auto along_ray = [&](V where, V opacity) {
        return hn::Min(hn::Max(hn::Div(where, hn::Mul(opacity, length2)), zero), one);
      };
      V seen = along_ray(place, sum.a);
      if constexpr (kAims) {
        const V faint = hn::Set(d, kFaint / (kHalf ? 1.f : 1.f / 255));
        seen = hn::IfThenElse(hn::Gt(sum.a, faint), seen, hn::LoadU(d, t + k));
        for (std::size_t c = 0; c < 3; ++c) {
          const auto saw =
              hn::Gt(opacities[c], hn::Mul(hn::LoadU(d, &entries.weight[c][k]), faint));
          const V own = hn::IfThenElse(saw, along_ray(places[c], opacities[c]), seen);
          store(hn::Mul(hn::Add(seen, own), hn::Set(d, 0.5f)), entries.t[c], k);
        }
      } else {
        hn::StoreU(hn::IfThenElseZero(hn::Gt(sum.a, zero), seen), d, t + k);
      }
    }
    if constexpr (!kAims)
      hn::StoreInterleaved4(hn::Mul(sum.r, unit), hn::Mul(sum.g, unit), hn::Mul(sum.b, unit),
                            hn::Mul(sum.a, unit), d, &rgba[k].x);
  }
}

void blend_any(const Pass& pass, const RayBlock& rays, EntryArrays& entries,
               const SampleArrays& samples, bool half_floats, glm::vec4* rgba, float* t) {
  const auto typed = [&](auto half) {
    constexpr bool kHalf = decltype(half)::value;
    return pass.aims         ? blend_typed<kHalf, true, true>
           : pass.with_depth ? blend_typed<kHalf, true, false>
                             : blend_typed<kHalf, false, false>;
  };
  (half_floats ? typed(std::true_type()) : typed(std::false_type()))(pass, rays, entries, samples,
                                                                     rgba, t);
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
HWY_EXPORT(number_tiles_any);
HWY_EXPORT(take_samples_any);
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

void number_tiles(const Pass& pass, const EntryArrays& entries, std::size_t count,
                  TileNumbers& numbers, TileArrays& tiles) {
  HWY_DYNAMIC_DISPATCH(number_tiles_any)(pass, entries, count, numbers, tiles);
}

void take_samples(const TileOffsets& offsets, const Pass& pass, const EntryArrays& entries,
                  const TileArrays& tiles, std::size_t count, std::uint32_t columns,
                  bool half_floats, bool add, SampleArrays& samples) {
  HWY_DYNAMIC_DISPATCH(take_samples_any)
  (offsets, pass, entries, tiles, count, columns, half_floats, add, samples);
}

void aim_at_depth(const RayBlock& rays, const EntryArrays& entries,
                  const std::array<const float*, 3>& t, std::array<PointArrays, 3>& aims) {
  HWY_DYNAMIC_DISPATCH(aim_at_depth_any)(rays, entries, t, aims);
}

void blend(const Pass& pass, const RayBlock& rays, EntryArrays& entries,
           const SampleArrays& samples, bool half_floats, glm::vec4* rgba, float* t) {
  HWY_DYNAMIC_DISPATCH(blend_any)(pass, rays, entries, samples, half_floats, rgba, t);
}

}  // namespace slf
#endif  // HWY_ONCE
