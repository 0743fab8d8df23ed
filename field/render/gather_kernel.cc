#include "field/render/gather_kernel.h"

#include <type_traits>
#include <utility>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/render/gather_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include "field/render/render_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

using D64 = hn::ScalableTag<std::int64_t>;
using V64 = hn::Vec<D64>;

void number_tiles_any(const Pass& pass, const EntryCells& entries, std::size_t count,
                      BlockTiles& tiles, TileNumbers& numbers) {
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
      const auto assign = [&](auto same, VU found) {
        tile = hn::IfThenElse(hn::And(same, left), found, tile);
        left = hn::And(used, hn::Eq(tile, no_tile));
      };
      assign(hn::And(hn::Eq(entry, last_entry), hn::Eq(exit, last_exit)), last_tile);
      last_entry = entry, last_exit = exit;
      if (k > 0 && !hn::AllFalse(d, left)) {
        const std::size_t before = k - hn::Lanes(d);
        assign(hn::And(hn::Eq(entry, entry_at(before)), hn::Eq(exit, exit_at(before))),
               hn::LoadU(d, &numbers[c][before]));
      }
      while (!hn::AllFalse(d, left)) {
        const auto lane = k + static_cast<std::size_t>(hn::FindFirstTrue(d, left));
        const std::uint32_t a = entries.section[c][lane], b = pass.exit[c]->section[lane];
        assign(hn::And(hn::Eq(entry, hn::Set(d, a)), hn::Eq(exit, hn::Set(d, b))),
               hn::Set(d, tiles.number(a, b)));
      }
      hn::StoreU(tile, d, &numbers[c][k]);
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

/// The tiles that one entry vertex of each lane's ray samples.
class LaneTiles {
 public:
  HWY_INLINE LaneTiles(const TileOffsets& offsets, const std::uint32_t* numbers)
      : zeros_(offsets.zeros),
        numbers_(hn::LoadU(DU(), numbers)),
        first_(static_cast<std::int32_t>(numbers[0])),
        same_(hn::AllTrue(DU(), hn::Eq(numbers_, hn::Set(DU(), numbers[0])))) {}

  /// Where the tiles of half of the lanes begin in a layer.
  template <class Half>
  HWY_INLINE V64 begin(const std::vector<std::int64_t>& offsets, Half) const {
    const D64 d;
    const hn::RebindToSigned<Narrow> narrow;
    const std::int64_t* from = offsets.data() + 1;
    if (same_) return hn::Set(d, from[first_]);
    return hn::GatherIndex(d, from,
                           hn::PromoteTo(d, hn::BitCast(narrow, half_of<Half::value>(numbers_))));
  }

  /// Loads 8 bytes for each lane of a half, from `at - before` bytes into its tile; zeros where
  /// there is none.
  template <class Half>
  HWY_INLINE V64 load(V64 begin, Half, VU at, int before) const {
    const D64 d;
    const V64 within =
        hn::IfThenZeroElse(hn::Eq(begin, hn::Zero(d)), widen(half_of<Half::value>(at)));
    return hn::GatherOffset(d, reinterpret_cast<const std::int64_t*>(zeros_ - before),
                            hn::Add(begin, within));
  }

 private:
  const std::byte* zeros_;
  VU numbers_;
  std::int32_t first_;  // of the numbers
  bool same_;           // all of them
};

template <bool kHalf, bool kDepth>
void gather_typed(const TileOffsets& offsets, const Pass& pass, const EntryCells& entries,
                  const TileNumbers& numbers, std::size_t count, bool add, BlockSamples& samples) {
  const D64 d;
  const DU du;
  const hn::RebindToUnsigned<D64> du64;
  const auto store_or = [&](auto v, auto tag, auto* to) {
    hn::StoreU(add ? hn::Or(v, hn::LoadU(tag, to)) : v, tag, to);
  };
  for (std::size_t c = 0; c < pass.entries; ++c) {
    const ExitCells& exit = *pass.exit[c];
    for (std::size_t k = 0; k < count; k += hn::Lanes(du)) {
      const LaneTiles tile(offsets, &numbers[c][k]);
      const VU row = hn::LoadU(du, &entries.row[c][k]);
      const VU pair = hn::Add(row, hn::LoadU(du, &exit.pair[k]));
      const VU third = hn::Add(row, hn::LoadU(du, &exit.third[k]));
      constexpr int kShift = kHalf ? 3 : 2;
      const VU pair_at = hn::ShiftLeft<kShift>(pair), third_at = hn::ShiftLeft<kShift>(third);
      V64 two[kHalves], one[kHalves], seen = hn::Zero(d);
      for_halves([&](auto half) {
        const V64 begin = tile.begin(offsets.color, half);
        two[half] = tile.load(begin, half, pair_at, 0);
        one[half] = tile.load(begin, half, third_at, kHalf ? 0 : 4);
        seen = hn::Or3(seen, two[half], one[half]);
        if constexpr (kHalf) {
          const auto put = [&](std::size_t e, V64 v) {
            store_or(hn::BitCast(du64, v), du64,
                     &samples.rgba16f[3 * c + e][k + half * hn::Lanes(d)]);
          };
          const V64 second = tile.load(begin, half, pair_at, -8);
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
          const V64 begin = tile.begin(offsets.depth, half);
          const auto pairs = hn::BitCast(du64, tile.load(begin, half, pair, 6));
          const auto thirds = hn::BitCast(du64, tile.load(begin, half, third, 7));
          two[half] =
              hn::BitCast(d, hn::Or(hn::ShiftRight<48>(pairs),
                                    hn::And(hn::ShiftRight<40>(thirds), hn::Set(du64, 0xFF0000))));
        });
        store_or(lower_bits(two), du, &samples.depth[c][k]);
      }
    }
  }
}

void gather_samples_any(const TileOffsets& offsets, const Pass& pass, const EntryCells& entries,
                        const TileNumbers& numbers, std::size_t count, bool half_floats, bool add,
                        BlockSamples& samples) {
  const auto typed =
      half_floats ? (pass.with_depth ? gather_typed<true, true> : gather_typed<true, false>)
                  : (pass.with_depth ? gather_typed<false, true> : gather_typed<false, false>);
  typed(offsets, pass, entries, numbers, count, add, samples);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(number_tiles_any);
HWY_EXPORT(gather_samples_any);

void number_tiles(const Pass& pass, const EntryCells& entries, std::size_t count, BlockTiles& tiles,
                  TileNumbers& numbers) {
  HWY_DYNAMIC_DISPATCH(number_tiles_any)(pass, entries, count, tiles, numbers);
}

void gather_samples(const TileOffsets& offsets, const Pass& pass, const EntryCells& entries,
                    const TileNumbers& numbers, std::size_t count, bool half_floats, bool add,
                    BlockSamples& samples) {
  HWY_DYNAMIC_DISPATCH(gather_samples_any)
  (offsets, pass, entries, numbers, count, half_floats, add, samples);
}

}  // namespace slf
#endif  // HWY_ONCE
