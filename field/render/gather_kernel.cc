#include "field/render/gather_kernel.h"

#include <atomic>
#include <type_traits>

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

/// Where the tiles of one entry vertex of each lane's ray begin, as in TileBegins.
struct LaneBegins {
  V64 color[kHalves], depth[kHalves];

  /// Finds those that the frame found before, in the table: returns these lanes.
  HWY_INLINE hn::Mask<DU> find(const BlockTiles& tiles, VU entry, VU exit) {
    const D64 d;
    const auto set = [](auto v) { return hn::Set(D64(), static_cast<std::int64_t>(v)); };
    const V64 zeros = set(reinterpret_cast<std::uintptr_t>(tiles.zeros()));
    const auto from_zeros = [&](V64 samples) {
      return hn::IfThenZeroElse(hn::Eq(samples, hn::Zero(d)), hn::Sub(samples, zeros));
    };
    const auto* pages = reinterpret_cast<const std::int64_t*>(tiles.table().pages());
    V64 found[kHalves];
    for_halves([&](auto half) {
      const V64 row =
          hn::ShiftLeftSame(widen(half_of<half.value>(entry)), tiles.table().exit_bits());
      const V64 page = hn::Add(row, widen(half_of<half.value>(exit)));
      const V64 at = hn::ShiftLeft<hwy::CeilLog2(sizeof(TilePage))>(page);
      const V64 state = hn::And(hn::GatherOffset(d, pages + 2, at), set(tiles.found_mask()));
      found[half] = hn::VecFromMask(d, hn::Eq(state, set(tiles.found_value())));
      std::atomic_thread_fence(std::memory_order_acquire);
      color[half] = from_zeros(hn::GatherOffset(d, pages, at));
      depth[half] =
          tiles.with_depth() ? from_zeros(hn::GatherOffset(d, pages + 1, at)) : hn::Zero(d);
    });
    return hn::MaskFromVec(lower_bits(found));
  }

  /// Gives all lanes one tile.
  HWY_INLINE void set(const BlockTiles::Found& tile) {
    for_halves([&](auto half) {
      color[half] = hn::Set(D64(), tile.color);
      depth[half] = hn::Set(D64(), tile.depth);
    });
  }

  /// Gives some lanes one tile.
  HWY_INLINE void set(const BlockTiles::Found& tile, hn::Mask<DU> of) {
    for_halves([&](auto half) {
      const auto lanes = wide<half.value>(of);
      color[half] = hn::IfThenElse(lanes, hn::Set(D64(), tile.color), color[half]);
      depth[half] = hn::IfThenElse(lanes, hn::Set(D64(), tile.depth), depth[half]);
    });
  }

  /// Takes their tiles from all but these lanes.
  HWY_INLINE void keep(hn::Mask<DU> of) {
    for_halves([&](auto half) {
      color[half] = hn::IfThenElseZero(wide<half.value>(of), color[half]);
      depth[half] = hn::IfThenElseZero(wide<half.value>(of), depth[half]);
    });
  }

  /// Prefetches the colours so many bytes into the tiles. So the gathers, which begin when all
  /// tiles of a block are found, wait less.
  HWY_INLINE void prefetch_colors(const std::byte* zeros, VU within) const {
    const D64 d;
    HWY_ALIGN std::int64_t at[kHalves * hn::MaxLanes(D64())];
    for_halves([&](auto half) {
      hn::Store(hn::Add(color[half], widen(half_of<half.value>(within))), d,
                at + half * hn::Lanes(d));
    });
    for (std::size_t k = 0; k < hn::Lanes(DU()); ++k) __builtin_prefetch(zeros + at[k]);
  }

  HWY_INLINE void store(bool with_depth, std::int64_t* colors, std::int64_t* depths) const {
    const D64 d;
    for_halves([&](auto half) {
      hn::StoreU(color[half], d, colors + half * hn::Lanes(d));
      if (with_depth) hn::StoreU(depth[half], d, depths + half * hn::Lanes(d));
    });
  }

 private:
  template <std::size_t half>
  static HWY_INLINE hn::Mask<D64> wide(hn::Mask<DU> mask) {
    return hn::Ne(widen(half_of<half>(hn::VecFromMask(DU(), mask))), hn::Zero(D64()));
  }
};

void find_tiles_any(const Pass& pass, const EntryCells& entries, std::size_t count,
                    bool half_floats, BlockTiles& tiles, TileBegins& begins) {
  const DU d;
  LaneBegins lanes;
  VU last_entry = hn::Zero(d), last_exit = last_entry;
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    bool again = false;  // `lanes` has the tiles of all these rays' last entry vertex
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const std::uint32_t *entry_at = &entries.section[c][k], *exit_at = &pass.exit[c]->section[k];
      const auto used =
          hn::And(hn::RebindMask(d, hn::Gt(hn::LoadU(D(), &entries.weight[c][k]), hn::Zero(D()))),
                  hn::FirstN(d, count - k));
      const VU entry = hn::IfThenElseZero(used, hn::LoadU(d, entry_at));
      const VU exit = hn::IfThenElseZero(used, hn::LoadU(d, exit_at));
      const auto all = [&](VU a, VU b) {
        return hn::AllTrue(d, hn::And(hn::Eq(entry, a), hn::Eq(exit, b)));
      };
      // Mostly a ray's entry vertices share a tile, and often those of all lanes do.
      if (!(again && all(last_entry, last_exit))) {
        again = hn::AllTrue(d, used);
        last_entry = entry, last_exit = exit;
        auto found = hn::FirstN(d, 0);
        if (again && all(hn::Set(d, *entry_at), hn::Set(d, *exit_at))) {
          const auto tile = tiles.find(*entry_at, *exit_at);
          lanes.set(tile);
          found = used;
          if (tile.unavailable) hn::StoreU(hn::Set(d, 1), d, &begins.unavailable[k]);
        } else if (tiles.table()) {
          found = hn::And(lanes.find(tiles, entry, exit), used);
        }
        if (!hn::AllTrue(d, found)) {
          lanes.keep(found);
          for (auto left = hn::AndNot(found, used); !hn::AllFalse(d, left);) {
            const auto lane = static_cast<std::size_t>(hn::FindFirstTrue(d, left));
            const auto same = hn::And(left, hn::And(hn::Eq(entry, hn::Set(d, entry_at[lane])),
                                                    hn::Eq(exit, hn::Set(d, exit_at[lane]))));
            const auto tile = tiles.find(entry_at[lane], exit_at[lane]);
            lanes.set(tile, same);
            if (tile.unavailable)
              hn::StoreU(hn::Or(hn::LoadU(d, &begins.unavailable[k]), hn::VecFromMask(d, same)), d,
                         &begins.unavailable[k]);
            left = hn::AndNot(same, left);
          }
        }
      }
      lanes.store(pass.with_depth, &begins.color[c][k], &begins.depth[c][k]);
      const VU pair =
          hn::Add(hn::LoadU(d, &entries.row[c][k]), hn::LoadU(d, &pass.exit[c]->pair[k]));
      lanes.prefetch_colors(begins.zeros, hn::ShiftLeftSame(pair, half_floats ? 3 : 2));
    }
  }
}

/// Loads 8 bytes for each lane, from `at - before` bytes into its tile; zeros where there is none.
HWY_INLINE V64 load(const std::byte* zeros, V64 begin, V64 at, int before) {
  const D64 d;
  const V64 within = hn::IfThenZeroElse(hn::Eq(begin, hn::Zero(d)), at);
  return hn::GatherOffset(d, reinterpret_cast<const std::int64_t*>(zeros - before),
                          hn::Add(begin, within));
}

template <bool kHalf, bool kDepth>
void gather_typed(const TileBegins& begins, const Pass& pass, const EntryCells& entries,
                  std::size_t count, bool add, BlockSamples& samples) {
  const D64 d;
  const DU du;
  const hn::RebindToUnsigned<D64> du64;
  const auto store_or = [&](auto v, auto tag, auto* to) {
    hn::StoreU(add ? hn::Or(v, hn::LoadU(tag, to)) : v, tag, to);
  };
  for (std::size_t c = 0; c < pass.entries; ++c) {
    const ExitCells& exit = *pass.exit[c];
    for (std::size_t k = 0; k < count; k += hn::Lanes(du)) {
      const VU row = hn::LoadU(du, &entries.row[c][k]);
      const VU pair = hn::Add(row, hn::LoadU(du, &exit.pair[k]));
      const VU third = hn::Add(row, hn::LoadU(du, &exit.third[k]));
      constexpr int kShift = kHalf ? 3 : 2;
      V64 two[kHalves], one[kHalves], seen = hn::Zero(d);
      for_halves([&](auto half) {
        const V64 begin = hn::LoadU(d, &begins.color[c][k + half * hn::Lanes(d)]);
        const V64 pair_at = hn::ShiftLeft<kShift>(widen(half_of<half.value>(pair)));
        const V64 third_at = hn::ShiftLeft<kShift>(widen(half_of<half.value>(third)));
        two[half] = load(begins.zeros, begin, pair_at, 0);
        one[half] = load(begins.zeros, begin, third_at, kHalf ? 0 : 4);
        seen = hn::Or3(seen, two[half], one[half]);
        if constexpr (kHalf) {
          const auto put = [&](std::size_t e, V64 v) {
            store_or(hn::BitCast(du64, v), du64,
                     &samples.rgba16f[3 * c + e][k + half * hn::Lanes(d)]);
          };
          const V64 second = load(begins.zeros, begin, pair_at, -8);
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
          const V64 begin = hn::LoadU(d, &begins.depth[c][k + half * hn::Lanes(d)]);
          const auto load_at = [&](VU at, int before) {
            return hn::BitCast(du64,
                               load(begins.zeros, begin, widen(half_of<half.value>(at)), before));
          };
          two[half] = hn::BitCast(
              d, hn::Or(hn::ShiftRight<48>(load_at(pair, 6)),
                        hn::And(hn::ShiftRight<40>(load_at(third, 7)), hn::Set(du64, 0xFF0000))));
        });
        store_or(lower_bits(two), du, &samples.depth[c][k]);
      }
    }
  }
}

void gather_samples_any(const TileBegins& begins, const Pass& pass, const EntryCells& entries,
                        std::size_t count, bool half_floats, bool add, BlockSamples& samples) {
  const auto typed =
      half_floats ? (pass.with_depth ? gather_typed<true, true> : gather_typed<true, false>)
                  : (pass.with_depth ? gather_typed<false, true> : gather_typed<false, false>);
  typed(begins, pass, entries, count, add, samples);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(find_tiles_any);
HWY_EXPORT(gather_samples_any);

void find_tiles(const Pass& pass, const EntryCells& entries, std::size_t count, bool half_floats,
                BlockTiles& tiles, TileBegins& begins) {
  HWY_DYNAMIC_DISPATCH(find_tiles_any)(pass, entries, count, half_floats, tiles, begins);
}

void gather_samples(const TileBegins& begins, const Pass& pass, const EntryCells& entries,
                    std::size_t count, bool half_floats, bool add, BlockSamples& samples) {
  HWY_DYNAMIC_DISPATCH(gather_samples_any)
  (begins, pass, entries, count, half_floats, add, samples);
}

}  // namespace slf
#endif  // HWY_ONCE
