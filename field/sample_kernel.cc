#include "field/sample_kernel.h"

#include <algorithm>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/sample_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include "field/render_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

using D64 = hn::ScalableTag<std::int64_t>;
using V64 = hn::Vec<D64>;

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
  // Mostly a ray's entry slots share a tile, and so do rays that follow each other.
  VU tile = no_tile, last_entry = no_tile, last_exit = no_tile;
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const VU entry = hn::LoadU(d, &entries.section[c][k]);
      const VU exit = hn::LoadU(d, &pass.exit[c]->section[k]);
      const auto used =
          hn::And(hn::RebindMask(d, hn::Gt(hn::LoadU(D(), &entries.weight[c][k]), hn::Zero(D()))),
                  hn::FirstN(d, count - k));
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

struct Colors {
  V r, g, b, a;
};

/// Byte `k` of each lane, 0 the lowest.
template <int k>
HWY_INLINE V byte_of(VU v) {
  const VU shifted = hn::ShiftRight<8 * k>(v);
  return to_float(hn::BitCast(DI(), k == 3 ? shifted : hn::And(shifted, hn::Set(DU(), 255))));
}

HWY_INLINE Colors load_colors(const RayArray<std::uint32_t>& from, std::size_t k) {
  const VU v = hn::LoadU(DU(), from.data() + k);
  return {byte_of<0>(v), byte_of<1>(v), byte_of<2>(v), byte_of<3>(v)};
}

HWY_INLINE Colors load_colors(const RayArray<std::uint64_t>& from, std::size_t k) {
  const hn::Rebind<std::uint16_t, D> bits;
  const hn::Rebind<hwy::float16_t, D> half;
  hn::Vec<decltype(bits)> r, g, b, a;
  hn::LoadInterleaved4(bits, reinterpret_cast<const std::uint16_t*>(from.data() + k), r, g, b, a);
  const auto to_float = [&](auto v) { return hn::PromoteTo(D(), hn::BitCast(half, v)); };
  return {to_float(r), to_float(g), to_float(b), to_float(a)};
}

/// Writes the pixels of the rays from `k` on.
HWY_INLINE void store_pixels(const Colors& colors, const RayBlock& rays, std::size_t k,
                             glm::vec4* picture) {
  const D d;
  const std::size_t n = std::min(hn::Lanes(d), rays.count - k);
  const std::uint32_t* pixel = &rays.pixel[k];  // they ascend
  const bool together = n == hn::Lanes(d) && pixel[n - 1] - pixel[0] == n - 1;
  glm::vec4 apart[hn::MaxLanes(D())];
  glm::vec4* to = together ? picture + pixel[0] : apart;
  hn::StoreInterleaved4(colors.r, colors.g, colors.b, colors.a, d, &to->x);
  if (together) return;
  for (std::size_t i = 0; i < n; ++i) picture[pixel[i]] = apart[i];
}

/// Below this opacity a depth is not worth following.
constexpr float kFaint = 1.f / 255;
/// What samples that do not agree at all still count: where nothing agrees, all must do.
constexpr float kDisagreeing = 0.1f;
/// Samples of a quarter of full opacity are judged as if they had it all; fainter ones less.
constexpr float kJudged = 0.25f;

template <bool kHalf, bool kDepth, bool kAgree>
void blend_typed(const Pass& pass, const RayBlock& rays, EntryArrays& entries,
                 const SampleArrays& samples, glm::vec4* picture, float* t) {
  const D d;
  constexpr float kFull = kHalf ? 1.f : 255.f;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), faint = hn::Set(d, kFaint * kFull);
  const V most = hn::Set(d, 1 - kDisagreeing);
  const V by_opacity = hn::Set(d, (1 - kDisagreeing) / (kJudged * kFull));
  const V sharpness = hn::Set(d, kAgree ? 1 / pass.spread : 0.f);
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    Colors sum{zero, zero, zero, zero};
    V total = zero;                  // of the weights
    V opacity = zero, place = zero;  // the latter times the former, as in the next line
    V opacities[3], places[3];
    const Point enter = Point::load(rays.enter, k);
    const Point ray = Point::load(rays.leave, k).minus(enter);
    const V inverse = kDepth ? hn::Div(one, ray.dot(ray)) : zero;
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const V weight = hn::LoadU(d, entries.weight[c].data() + k);
      V depths[3], seen = zero, depth = zero, offset = zero, slope = zero;
      V begin = zero, scale = zero;  // where its samples lie along the ray: begin + depth · scale
      if constexpr (kDepth) {
        const VU three = hn::LoadU(DU(), samples.depth[c].data() + k);
        depths[0] = byte_of<0>(three), depths[1] = byte_of<1>(three), depths[2] = byte_of<2>(three);
        const Point from = Point::load(entries.point[c], k);
        const Point aim = Point::load(*pass.aim[c], k).minus(from);
        begin = hn::Mul(from.minus(enter).dot(ray), inverse);
        scale = hn::Mul(aim.dot(ray), hn::Mul(inverse, hn::Set(d, 1.f / 255)));
      }
      if constexpr (kAgree) {
        offset = hn::Mul(hn::Sub(begin, hn::LoadU(d, &entries.t[c][k])), sharpness);
        slope = hn::Mul(scale, sharpness);
      }
      for (std::size_t e = 0; e < 3; ++e) {
        const V share = hn::Mul(weight, hn::LoadU(d, pass.exit[c]->weight[e].data() + k));
        const Colors v = kHalf ? load_colors(samples.rgba16f[3 * c + e], k)
                               : load_colors(samples.rgba8[3 * c + e], k);
        V w = share;
        if constexpr (kDepth) {
          const V visible = hn::Mul(share, v.a);
          seen = hn::Add(seen, visible);
          depth = hn::MulAdd(visible, depths[e], depth);
        }
        if constexpr (kAgree) {
          const V off = hn::MulAdd(depths[e], slope, offset);
          const V apart = hn::Min(hn::Mul(off, off), one);
          const V lost = hn::Mul(apart, hn::Min(hn::Mul(v.a, by_opacity), most));
          w = hn::NegMulAdd(lost, share, share);
          total = hn::Add(total, w);
        }
        sum.r = hn::MulAdd(w, v.r, sum.r);
        sum.g = hn::MulAdd(w, v.g, sum.g);
        sum.b = hn::MulAdd(w, v.b, sum.b);
        sum.a = hn::MulAdd(w, v.a, sum.a);
      }
      if constexpr (kDepth) {
        opacities[c] = seen;
        places[c] = hn::MulAdd(seen, begin, hn::Mul(depth, scale));
        opacity = hn::Add(opacity, seen);
        place = hn::Add(place, places[c]);
      }
    }
    if constexpr (kDepth) {
      const auto mean = [&](V of, V weight) {
        return hn::Min(hn::Max(hn::Div(of, weight), zero), one);
      };
      const auto enough = hn::Gt(opacity, faint);
      V all = mean(place, opacity);
      V step = zero;
      if constexpr (kAgree) {
        all = hn::IfThenElse(enough, all, hn::LoadU(d, t + k));
        for (std::size_t c = 0; c < 3; ++c) {
          const V weight = hn::LoadU(d, &entries.weight[c][k]);
          const auto saw = hn::Gt(opacities[c], hn::Mul(weight, faint));
          const V own = hn::IfThenElse(saw, mean(places[c], opacities[c]), all);
          const V next = hn::Mul(hn::Add(all, own), hn::Set(d, 0.5f));
          const V moved = hn::AbsDiff(next, hn::LoadU(d, &entries.t[c][k]));
          step = hn::Max(step, hn::IfThenElseZero(hn::Gt(weight, zero), moved));
          store(next, entries.t[c], k);
        }
        const V whole = hn::Div(one, total);
        sum = {hn::Mul(sum.r, whole), hn::Mul(sum.g, whole), hn::Mul(sum.b, whole),
               hn::Mul(sum.a, whole)};
      } else {
        all = hn::IfThenElseZero(hn::Gt(opacity, zero), all);
        step = hn::IfThenElseZero(enough, one);
        for (std::size_t c = 0; c < 3; ++c) store(all, entries.t[c], k);
      }
      store(step, entries.step, k);
      hn::StoreU(all, d, t + k);
    }
    const V unit = hn::Set(d, 1 / kFull);
    store_pixels(
        {hn::Mul(sum.r, unit), hn::Mul(sum.g, unit), hn::Mul(sum.b, unit), hn::Mul(sum.a, unit)},
        rays, k, picture);
  }
}

void blend_any(const Pass& pass, const RayBlock& rays, EntryArrays& entries,
               const SampleArrays& samples, bool half_floats, glm::vec4* picture, float* t) {
  const auto typed = [&](auto half) {
    constexpr bool kHalf = decltype(half)::value;
    return pass.spread > 0   ? blend_typed<kHalf, true, true>
           : pass.with_depth ? blend_typed<kHalf, true, false>
                             : blend_typed<kHalf, false, false>;
  };
  (half_floats ? typed(std::true_type()) : typed(std::false_type()))(pass, rays, entries, samples,
                                                                     picture, t);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(number_tiles_any);
HWY_EXPORT(take_samples_any);
HWY_EXPORT(blend_any);

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

void blend(const Pass& pass, const RayBlock& rays, EntryArrays& entries,
           const SampleArrays& samples, bool half_floats, glm::vec4* picture, float* t) {
  HWY_DYNAMIC_DISPATCH(blend_any)(pass, rays, entries, samples, half_floats, picture, t);
}

}  // namespace slf
#endif  // HWY_ONCE
