#include "field/render/sample_kernel.h"

#include <algorithm>
#include <type_traits>
#include <utility>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/render/sample_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include "field/render/render_vectors-inl.h"

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
  // Mostly a ray's entry slots share a tile, or it is the one of a ray nearby.
  VU tile = no_tile, last_entry = no_tile, last_exit = no_tile;
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const auto entry_at = [&](std::size_t at) { return hn::LoadU(d, &entries.section[c][at]); };
      const auto exit_at = [&](std::size_t at) { return hn::LoadU(d, &pass.exit[c]->section[at]); };
      const VU entry = entry_at(k), exit = exit_at(k), last_tile = std::exchange(tile, no_tile);
      const auto used =
          hn::And(hn::RebindMask(d, hn::Gt(hn::LoadU(D(), &entries.weight[c][k]), hn::Zero(D()))),
                  hn::FirstN(d, count - k));
      auto left = used;
      const auto take = [&](auto same, VU found) {
        tile = hn::IfThenElse(hn::And(same, left), found, tile);
        left = hn::And(used, hn::Eq(tile, no_tile));
      };
      take(hn::And(hn::Eq(entry, last_entry), hn::Eq(exit, last_exit)), last_tile);
      last_entry = entry, last_exit = exit;
      if (k > 0 && !hn::AllFalse(d, left)) {
        const std::size_t before = k - hn::Lanes(d);
        take(hn::And(hn::Eq(entry, entry_at(before)), hn::Eq(exit, exit_at(before))),
             hn::LoadU(d, &tiles[c][before]));
      }
      if (!hn::AllFalse(d, left)) take(left, recent_numbers(numbers.recent(), entry, exit));
      while (!hn::AllFalse(d, left)) {
        const auto lane = k + static_cast<std::size_t>(hn::FindFirstTrue(d, left));
        const TileNumbers::Pair pair{entries.section[c][lane], pass.exit[c]->section[lane]};
        take(hn::And(hn::Eq(entry, hn::Set(d, pair.entry)), hn::Eq(exit, hn::Set(d, pair.exit))),
             hn::Set(d, numbers.number(pair)));
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

/// Half of a vector, the lower one first.
template <std::size_t half>
HWY_INLINE hn::Vec<Narrow> half_of(VU v) {
#if HWY_TARGET == HWY_SCALAR
  return v;
#else
  return half == 0 ? hn::LowerHalf(Narrow(), v) : hn::UpperHalf(Narrow(), v);
#endif
}

/// Calls f for each half of vectors.
template <class F>
HWY_INLINE void for_halves(const F& f) {
  f(std::integral_constant<std::size_t, 0>());
  if constexpr (kHalves == 2) f(std::integral_constant<std::size_t, kHalves - 1>());
}

/// The tiles of as many rays as there are lanes.
class Tiles {
 public:
  HWY_INLINE Tiles(const TileOffsets& offsets, const std::uint32_t* numbers)
      : zeros_(offsets.zeros),
        numbers_(hn::LoadU(DU(), numbers)),
        first_(static_cast<std::int32_t>(numbers[0])),
        same_(hn::AllTrue(DU(), hn::Eq(numbers_, hn::Set(DU(), numbers[0])))) {}

  /// Loads 8 bytes for each lane of a half, from `at - before` bytes into its tile; zeros where
  /// there is none.
  template <class Half>
  HWY_INLINE V64 load(const std::vector<std::int64_t>& offsets, Half, VU at, int before) const {
    const D64 d;
    const hn::RebindToSigned<Narrow> narrow;
    const std::int64_t* from = offsets.data() + 1;
    const V64 tile =
        same_ ? hn::Set(d, from[first_])
              : hn::GatherIndex(
                    d, from, hn::PromoteTo(d, hn::BitCast(narrow, half_of<Half::value>(numbers_))));
    const V64 within =
        hn::IfThenZeroElse(hn::Eq(tile, hn::Zero(d)), widen(half_of<Half::value>(at)));
    return hn::GatherOffset(d, reinterpret_cast<const std::int64_t*>(zeros_ - before),
                            hn::Add(tile, within));
  }

 private:
  const std::byte* zeros_;
  VU numbers_;
  std::int32_t first_;  // of the numbers
  bool same_;           // all of them
};

template <bool kHalf, bool kDepth>
void take_typed(const TileOffsets& offsets, const Pass& pass, const EntryArrays& entries,
                const TileArrays& tiles, std::size_t count, bool add, SampleArrays& samples) {
  const D64 d;
  const DU du;
  const hn::RebindToUnsigned<D64> du64;
  const auto store_or = [&](auto v, auto tag, auto* to) {
    hn::StoreU(add ? hn::Or(v, hn::LoadU(tag, to)) : v, tag, to);
  };
  for (std::size_t c = 0; c < pass.entries; ++c) {
    const ExitArrays& exit = *pass.exit[c];
    for (std::size_t k = 0; k < count; k += hn::Lanes(du)) {
      const Tiles tile(offsets, &tiles[c][k]);
      const VU row = hn::LoadU(du, &entries.row[c][k]);
      const VU pair = hn::Add(row, hn::LoadU(du, &exit.pair[k]));
      const VU third = hn::Add(row, hn::LoadU(du, &exit.third[k]));
      constexpr int kShift = kHalf ? 3 : 2;
      const VU pair_at = hn::ShiftLeft<kShift>(pair), third_at = hn::ShiftLeft<kShift>(third);
      V64 two[kHalves], one[kHalves], seen = hn::Zero(d);
      for_halves([&](auto half) {
        two[half] = tile.load(offsets.color, half, pair_at, 0);
        one[half] = tile.load(offsets.color, half, third_at, kHalf ? 0 : 4);
        seen = hn::Or3(seen, two[half], one[half]);
        if constexpr (kHalf) {
          const auto put = [&](std::size_t e, V64 v) {
            store_or(hn::BitCast(du64, v), du64,
                     &samples.rgba16f[3 * c + e][k + half * hn::Lanes(d)]);
          };
          const V64 second = tile.load(offsets.color, half, pair_at, -8);
          put(0, two[half]), put(1, second), put(2, one[half]);
          seen = hn::Or(seen, second);
        }
      });
      if constexpr (!kHalf) {
        store_or(lower_bits(two), du, &samples.rgba8[3 * c][k]);
        store_or(upper_bits(two), du, &samples.rgba8[3 * c + 1][k]);
        store_or(upper_bits(one), du, &samples.rgba8[3 * c + 2][k]);
      }
      if constexpr (kDepth) {
        if (!add && hn::AllTrue(d, hn::Eq(seen, hn::Zero(d)))) {  // no depth means anything
          hn::StoreU(hn::Zero(du), du, &samples.depth[c][k]);
          continue;
        }
        for_halves([&](auto half) {  // the last two of 8 bytes, and the last one
          const auto pairs = hn::BitCast(du64, tile.load(offsets.depth, half, pair, 6));
          const auto thirds = hn::BitCast(du64, tile.load(offsets.depth, half, third, 7));
          two[half] =
              hn::BitCast(d, hn::Or(hn::ShiftRight<48>(pairs),
                                    hn::And(hn::ShiftRight<40>(thirds), hn::Set(du64, 0xFF0000))));
        });
        store_or(lower_bits(two), du, &samples.depth[c][k]);
      }
    }
  }
}

void take_samples_any(const TileOffsets& offsets, const Pass& pass, const EntryArrays& entries,
                      const TileArrays& tiles, std::size_t count, bool half_floats, bool add,
                      SampleArrays& samples) {
  const auto typed = half_floats
                         ? (pass.with_depth ? take_typed<true, true> : take_typed<true, false>)
                         : (pass.with_depth ? take_typed<false, true> : take_typed<false, false>);
  typed(offsets, pass, entries, tiles, count, add, samples);
}

struct Colors {
  V r, g, b, a;

  static HWY_INLINE Colors none() {
    const V zero = hn::Zero(D());
    return {zero, zero, zero, zero};
  }
  HWY_INLINE Colors times(V t) const {
    return {hn::Mul(r, t), hn::Mul(g, t), hn::Mul(b, t), hn::Mul(a, t)};
  }
  HWY_INLINE Colors plus(V t, const Colors& c) const {
    return {hn::MulAdd(t, c.r, r), hn::MulAdd(t, c.g, g), hn::MulAdd(t, c.b, b),
            hn::MulAdd(t, c.a, a)};
  }
};

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
  HWY_ALIGN glm::vec4 pixels[hn::MaxLanes(D())];
  hn::StoreInterleaved4(colors.r, colors.g, colors.b, colors.a, d, &pixels[0].x);
  const std::size_t n = std::min(hn::Lanes(d), rays.count - k);
  const std::uint32_t* to = &rays.pixel[k];
  const DU du;
  const VU step = hn::Sub(hn::LoadU(du, to + 1), hn::LoadU(du, to));
  const VU place =
      hn::And(hn::Iota(du, 1), hn::Set(du, PixelSquare::kAcross - 1));  // 0 where a run ends
  const auto runs = hn::Or(hn::Eq(step, hn::Set(du, 1)), hn::Eq(place, hn::Zero(du)));
  if (n == hn::Lanes(d) && hn::AllTrue(du, runs)) {
    for (std::size_t i = 0; i < n; i += PixelSquare::kAcross)
      std::copy_n(pixels + i, PixelSquare::kAcross, picture + to[i]);
  } else {
    for (std::size_t i = 0; i < n; ++i) picture[to[i]] = pixels[i];
  }
}

/// Below this opacity a depth is not worth following.
constexpr float kFaint = 1.f / 255;
/// What samples that do not agree at all still count: where nothing agrees, all must do.
constexpr float kDisagreeing = 0.1f;
/// Samples of a quarter of full opacity are judged as if they had it all; fainter ones less.
constexpr float kJudged = 0.25f;

/// Opacities and colours are stored as so much when full.
template <bool kHalf>
constexpr float kFull = kHalf ? 1.f : 255.f;

template <bool kHalf>
HWY_INLINE const auto& colors_of(const SampleArrays& samples) {
  if constexpr (kHalf)
    return samples.rgba16f;
  else
    return samples.rgba8;
}

/// Whether the rays from `k` on, as many as there are lanes, see nothing: many do, all of them.
template <bool kHalf>
HWY_INLINE bool blank(const Pass& pass, const SampleArrays& samples, std::size_t k) {
  const DU d;
  VU any = hn::Zero(d);
  for (std::size_t slot = 0; slot < 3 * pass.entries; ++slot) {
    const auto* words = reinterpret_cast<const std::uint32_t*>(&colors_of<kHalf>(samples)[slot][k]);
    for (std::size_t word = 0; word < (kHalf ? 2 : 1); ++word)
      any = hn::Or(any, hn::LoadU(d, words + word * hn::Lanes(d)));
  }
  return hn::AllTrue(d, hn::Eq(any, hn::Zero(d)));
}

/// What the rays from `k` on see if all their samples count alike.
template <bool kHalf>
HWY_INLINE Colors interpolate(const Pass& pass, const EntryArrays& entries,
                              const SampleArrays& samples, std::size_t k) {
  const D d;
  Colors sum = Colors::none();
  if (blank<kHalf>(pass, samples, k)) return sum;
  for (std::size_t c = 0; c < pass.entries; ++c) {
    const V weight = hn::LoadU(d, &entries.weight[c][k]);
    for (std::size_t e = 0; e < 3; ++e)
      sum = sum.plus(hn::Mul(weight, hn::LoadU(d, &pass.exit[c]->weight[e][k])),
                     load_colors(colors_of<kHalf>(samples)[3 * c + e], k));
  }
  return sum.times(hn::Set(d, 1 / kFull<kHalf>));
}

template <bool kHalf>
void blend_flat(const Pass& pass, const RayBlock& rays, const EntryArrays& entries,
                const SampleArrays& samples, glm::vec4* picture) {
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(D()))
    store_pixels(interpolate<kHalf>(pass, entries, samples, k), rays, k, picture);
}

template <bool kHalf, bool kAgree>
void blend_deep(const Pass& pass, const RayBlock& rays, EntryArrays& entries,
                const SampleArrays& samples, glm::vec4* picture, float* t) {
  const D d;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f), faint = hn::Set(d, kFaint * kFull<kHalf>);
  const V most = hn::Set(d, 1 - kDisagreeing);
  const V by_opacity = hn::Set(d, (1 - kDisagreeing) / (kJudged * kFull<kHalf>));
  const V sharpness = hn::Set(d, kAgree ? 1 / pass.spread : 0.f);
  const auto mean = [&](V of, V weight) {  // whatever half floats there are, it is in range
    const V at = hn::Div(of, weight);
    return hn::IfThenElseZero(hn::Gt(at, zero), hn::Min(at, one));
  };
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    if (!kAgree && blank<kHalf>(pass, samples, k)) {
      for (std::size_t c = 0; c < 3; ++c) store(zero, entries.t[c], k);
      store(zero, entries.step, k);
      hn::StoreU(zero, d, t + k);
      store_pixels(Colors::none(), rays, k, picture);
      continue;
    }
    Colors sum = Colors::none();
    V total = zero;                  // of the weights
    V opacity = zero, place = zero;  // the latter times the former, as in the next line
    V opacities[3], places[3];
    const Point enter = Point::load(rays.enter, k);
    const Point ray = Point::load(rays.leave, k).minus(enter);
    const V inverse = hn::Div(one, ray.dot(ray));
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const V weight = hn::LoadU(d, &entries.weight[c][k]);
      const VU three = hn::LoadU(DU(), &samples.depth[c][k]);
      const V depths[] = {byte_of<0>(three), byte_of<1>(three), byte_of<2>(three)};
      // Where its samples lie along the ray: begin + depth · scale.
      const Point from = Point::load(entries.point[c], k);
      const Point aim = Point::load(*pass.aim[c], k).minus(from);
      const V begin = hn::Mul(from.minus(enter).dot(ray), inverse);
      const V scale = hn::Mul(aim.dot(ray), hn::Mul(inverse, hn::Set(d, 1.f / 255)));
      V seen = zero, depth = zero, offset = zero, slope = zero;
      if constexpr (kAgree) {
        offset = hn::Mul(hn::Sub(begin, hn::LoadU(d, &entries.t[c][k])), sharpness);
        slope = hn::Mul(scale, sharpness);
      }
      for (std::size_t e = 0; e < 3; ++e) {
        const V share = hn::Mul(weight, hn::LoadU(d, &pass.exit[c]->weight[e][k]));
        const Colors v = load_colors(colors_of<kHalf>(samples)[3 * c + e], k);
        const V visible = hn::Mul(share, v.a);
        seen = hn::Add(seen, visible);
        depth = hn::MulAdd(visible, depths[e], depth);
        if constexpr (kAgree) {
          const V off = hn::MulAdd(depths[e], slope, offset);
          const V apart = hn::Min(hn::Mul(off, off), one);
          const V lost = hn::Mul(apart, hn::Min(hn::Mul(v.a, by_opacity), most));
          const V w = hn::NegMulAdd(lost, share, share);
          total = hn::Add(total, w);
          sum = sum.plus(w, v);
        }
      }
      opacities[c] = seen;
      places[c] = hn::MulAdd(seen, begin, hn::Mul(depth, scale));
      opacity = hn::Add(opacity, seen);
      place = hn::Add(place, places[c]);
    }
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
    } else {
      all = hn::IfThenElseZero(hn::Gt(opacity, zero), all);
      step = hn::IfThenElseZero(enough, hn::Inf(d));
      for (std::size_t c = 0; c < 3; ++c) store(all, entries.t[c], k);
    }
    store(step, entries.step, k);
    hn::StoreU(all, d, t + k);
    if constexpr (kAgree)
      store_pixels(sum.times(hn::Div(hn::Set(d, 1 / kFull<kHalf>), total)), rays, k, picture);
    else if (!pass.preview || !hn::AllTrue(d, enough))
      store_pixels(interpolate<kHalf>(pass, entries, samples, k), rays, k, picture);
  }
}

template <bool kHalf>
void blend_typed(const Pass& pass, const RayBlock& rays, EntryArrays& entries,
                 const SampleArrays& samples, glm::vec4* picture, float* t) {
  if (!pass.with_depth)
    blend_flat<kHalf>(pass, rays, entries, samples, picture);
  else if (pass.spread > 0)
    blend_deep<kHalf, true>(pass, rays, entries, samples, picture, t);
  else
    blend_deep<kHalf, false>(pass, rays, entries, samples, picture, t);
}

void blend_any(const Pass& pass, const RayBlock& rays, EntryArrays& entries,
               const SampleArrays& samples, bool half_floats, glm::vec4* picture, float* t) {
  (half_floats ? blend_typed<true> : blend_typed<false>)(pass, rays, entries, samples, picture, t);
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
                  const TileArrays& tiles, std::size_t count, bool half_floats, bool add,
                  SampleArrays& samples) {
  HWY_DYNAMIC_DISPATCH(take_samples_any)
  (offsets, pass, entries, tiles, count, half_floats, add, samples);
}

void blend(const Pass& pass, const RayBlock& rays, EntryArrays& entries,
           const SampleArrays& samples, bool half_floats, glm::vec4* picture, float* t) {
  HWY_DYNAMIC_DISPATCH(blend_any)(pass, rays, entries, samples, half_floats, picture, t);
}

}  // namespace slf
#endif  // HWY_ONCE
