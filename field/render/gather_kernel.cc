#include "field/render/gather_kernel.h"

#include <atomic>
#include <cstddef>
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

/// How many vectors of 64-bit lanes hold as many lanes as one of 32-bit lanes.
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

/// Half of a mask, for 64-bit lanes.
template <std::size_t half>
HWY_INLINE hn::Mask<D64> wide(hn::Mask<DU> mask) {
#if HWY_TARGET == HWY_AVX3
  return {static_cast<__mmask8>(mask.raw >> 8 * half)};
#else
  return hn::Ne(widen(half_of<half>(hn::VecFromMask(DU(), mask))), hn::Zero(D64()));
#endif
}

/// Loads 8 bytes for each of the chosen lanes, `at` bytes from `base`; zeros for the others.
/// REQUIRES: 8 bytes at `base` can be read.
///
/// On x86 a gather keeps the register's values in lanes that it does not load. So without a mask,
/// hn::GatherOffset may wait for an earlier result that happens to be in the register.
HWY_INLINE V64 gather(const std::byte* base, V64 at, hn::Mask<D64> chosen) {
#if HWY_TARGET == HWY_AVX3
  return V64{_mm512_mask_i64gather_epi64(_mm512_setzero_si512(), chosen.raw, at.raw, base, 1)};
#elif HWY_TARGET == HWY_AVX2
  const auto* words = reinterpret_cast<const long long*>(base);
  return V64{_mm256_mask_i64gather_epi64(_mm256_setzero_si256(), words, at.raw, chosen.raw, 1)};
#else
  const auto* words = reinterpret_cast<const std::int64_t*>(base);
  return hn::IfThenElseZero(chosen, hn::GatherOffset(D64(), words, hn::IfThenElseZero(chosen, at)));
#endif
}

/// The pages of tiles that the frame found before, as kernels load them.
struct FoundPages {
  const std::byte* first;  // page; null in an empty table
  int exit_bits;
  std::uint32_t stamp;
  bool with_depth;

  explicit FoundPages(const BlockTiles& tiles)
      : first(reinterpret_cast<const std::byte*>(tiles.table().pages())),
        exit_bits(tiles.table().exit_bits()),
        stamp(static_cast<std::uint32_t>(tiles.stamp())),
        with_depth(tiles.with_depth()) {}

  /// Loads a member of the chosen lanes' pages, which are `at` bytes from the first one.
  template <std::size_t member>
  [[nodiscard]] HWY_INLINE V64 load(V64 at, hn::Mask<D64> chosen) const {
    return gather(first + member, at, chosen);
  }
};

/// Stores a vector or, if `add`, its union with what is there.
template <class DT, class T>
HWY_INLINE void store_or(bool add, hn::Vec<DT> v, DT d, T* to) {
  hn::StoreU(add ? hn::Or(v, hn::LoadU(d, to)) : v, d, to);
}

/// Where the tiles of one entry vertex of each lane's ray begin, as in TileOffsets.
struct LaneBegins {
  V64 color[kHalves], depth[kHalves];

  LaneBegins() {
    for_halves([&](auto half) { color[half] = depth[half] = hn::Zero(D64()); });
  }

  /// Looks up the tiles of some lanes. Returns the lanes whose tiles the frame has found before.
  HWY_INLINE hn::Mask<DU> find(const FoundPages& pages, VU entry, VU exit, hn::Mask<DU> of) {
    const D64 d;
    const DU du;
    V64 at[kHalves], words[kHalves];
    for_halves([&](auto half) {
      const V64 row = hn::ShiftLeftSame(widen(half_of<half.value>(entry)), pages.exit_bits);
      const V64 page = hn::Add(row, widen(half_of<half.value>(exit)));
      at[half] = hn::ShiftLeft<hwy::CeilLog2(sizeof(TilePage))>(page);
      words[half] = pages.load<offsetof(TilePage, found)>(at[half], wide<half.value>(of));
      color[half] = hn::ShiftRight<TilePage::kStampBits>(words[half]);
    });
    std::atomic_thread_fence(std::memory_order_acquire);
    for_halves([&](auto half) {
      depth[half] = hn::Zero(d);
      if (!pages.with_depth) return;
      const V64 first = pages.load<offsetof(TilePage, depth)>(at[half], wide<half.value>(of));
      const V64 zeros =
          hn::Set(d, static_cast<std::int64_t>(reinterpret_cast<std::uintptr_t>(zero_samples())));
      depth[half] = hn::IfThenZeroElse(hn::Eq(first, hn::Zero(d)), hn::Sub(first, zeros));
    });
    const VU stamps = hn::And(lower_bits(words), hn::Set(du, std::uint32_t{TilePage::kStampMask}));
    return hn::Eq(stamps, hn::Set(du, pages.stamp));
  }

  /// The same for lanes that all need the tile of one page.
  HWY_INLINE hn::Mask<DU> find_one(const FoundPages& pages, const TilePage& page, hn::Mask<DU> of) {
    const std::uint64_t word = page.found.load(std::memory_order_acquire);
    if ((word & TilePage::kStampMask) != pages.stamp) return hn::FirstN(DU(), 0);
    BlockTiles::Found tile;
    tile.color = static_cast<std::int64_t>(word) >> TilePage::kStampBits;
    if (pages.with_depth) tile.depth = sample_offset(page.depth.load(std::memory_order_acquire));
    *this = {};
    set(tile, of);
    return of;
  }

  /// Sets the tile of some lanes.
  HWY_INLINE void set(const BlockTiles::Found& tile, hn::Mask<DU> of) {
    for_halves([&](auto half) {
      const auto lanes = wide<half.value>(of);
      color[half] = hn::IfThenElse(lanes, hn::Set(D64(), tile.color), color[half]);
      depth[half] = hn::IfThenElse(lanes, hn::Set(D64(), tile.depth), depth[half]);
    });
  }

  /// Clears the tiles of all other lanes.
  HWY_INLINE void keep(hn::Mask<DU> of) {
    for_halves([&](auto half) {
      color[half] = hn::IfThenElseZero(wide<half.value>(of), color[half]);
      depth[half] = hn::IfThenElseZero(wide<half.value>(of), depth[half]);
    });
  }

  HWY_INLINE void store(bool with_depth, std::int64_t* colors, std::int64_t* depths) const {
    const D64 d;
    for_halves([&](auto half) {
      hn::StoreU(color[half], d, colors + half * hn::Lanes(d));
      if (with_depth) hn::StoreU(depth[half], d, depths + half * hn::Lanes(d));
    });
  }
};

void find_tiles_any(const Pass& pass, const EntryCells& entries, std::size_t count,
                    BlockTiles& tiles, TileOffsets& offsets) {
  const DU d;
  const FoundPages pages(tiles);
  LaneBegins lanes;
  for (std::size_t k = 0; k < count; k += hn::Lanes(d)) {
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const std::uint32_t *entry_at = &entries.section[c][k], *exit_at = &pass.exit[c]->section[k];
      const auto used =
          hn::And(hn::RebindMask(d, hn::Gt(hn::LoadU(D(), &entries.weight[c][k]), hn::Zero(D()))),
                  hn::FirstN(d, count - k));
      const VU entry = hn::LoadU(d, entry_at), exit = hn::LoadU(d, exit_at);
      // Often all rays of a vector need one tile, which one load finds.
      const auto differ =
          hn::Or(hn::Ne(entry, hn::Set(d, *entry_at)), hn::Ne(exit, hn::Set(d, *exit_at)));
      auto found = hn::FirstN(d, 0);
      if (pages.first)
        found = hn::AllFalse(d, hn::And(used, differ))
                    ? lanes.find_one(pages, *tiles.table().find(*entry_at, *exit_at), used)
                    : hn::And(lanes.find(pages, entry, exit, used), used);
      if (!hn::AllTrue(d, found)) {
        lanes.keep(found);
        for (auto left = hn::AndNot(found, used); !hn::AllFalse(d, left);) {
          const auto lane = static_cast<std::size_t>(hn::FindFirstTrue(d, left));
          const auto same = hn::And(left, hn::And(hn::Eq(entry, hn::Set(d, entry_at[lane])),
                                                  hn::Eq(exit, hn::Set(d, exit_at[lane]))));
          const auto tile = tiles.find(entry_at[lane], exit_at[lane]);
          lanes.set(tile, same);
          if (tile.unavailable)
            hn::StoreU(hn::Or(hn::LoadU(d, &offsets.unavailable[k]), hn::VecFromMask(d, same)), d,
                       &offsets.unavailable[k]);
          left = hn::AndNot(same, left);
        }
      }
      lanes.store(pass.with_depth, &offsets.color[c][k], &offsets.depth[c][k]);
    }
  }
}

/// Whether the offsets of a vector of rays are all 0, so that all samples are 0. About a quarter
/// of the vectors of a view are like this.
HWY_INLINE bool all_empty(const std::int64_t* offsets) {
  const D64 d;
  V64 any = hn::Zero(d);
  for (std::size_t half = 0; half < kHalves; ++half)
    any = hn::Or(any, hn::LoadU(d, offsets + half * hn::Lanes(d)));
  return hn::AllTrue(d, hn::Eq(any, hn::Zero(d)));
}

/// Loads 8 bytes for each lane, `at - before` bytes into its tile; zeros for lanes without a tile.
HWY_INLINE V64 load(V64 begin, V64 at, int before) {
  return gather(zero_samples() - before, hn::Add(begin, at), hn::Ne(begin, hn::Zero(D64())));
}

template <bool kHalf, bool kDepth>
void gather_typed(const TileOffsets& offsets, const Pass& pass, const EntryCells& entries,
                  std::size_t count, bool add, BlockSamples& samples) {
  const D64 d;
  const DU du;
  const hn::RebindToUnsigned<D64> du64;
  const auto clear_words = [&](auto* to, std::size_t vectors) {
    auto* const words = reinterpret_cast<std::uint32_t*>(to);
    for (std::size_t v = 0; v < vectors; ++v)
      hn::StoreU(hn::Zero(du), du, words + v * hn::Lanes(du));
  };
  const auto clear = [&](std::size_t c, std::size_t k) {
    for (std::size_t e = 0; e < 3; ++e)
      if constexpr (kHalf)
        clear_words(&samples.rgba16f[3 * c + e][k], 2);
      else
        clear_words(&samples.rgba8[3 * c + e][k], 1);
    if constexpr (kDepth) clear_words(&samples.depth[c][k], 1);
  };
  for (std::size_t c = 0; c < pass.entries; ++c) {
    const ExitCells& exit = *pass.exit[c];
    for (std::size_t k = 0; k < count; k += hn::Lanes(du)) {
      if (all_empty(&offsets.color[c][k])) {
        if (!add) clear(c, k);
        continue;
      }
      const VU row = hn::LoadU(du, &entries.row_begin[c][k]);
      const VU pair = hn::Add(row, hn::LoadU(du, &exit.pair[k]));
      const VU third = hn::Add(row, hn::LoadU(du, &exit.third[k]));
      constexpr int kShift = kHalf ? 3 : 2;  // to bytes
      V64 two[kHalves], one[kHalves], seen = hn::Zero(d);
      for_halves([&](auto half) {
        const V64 begin = hn::LoadU(d, &offsets.color[c][k + half * hn::Lanes(d)]);
        const V64 pair_at = hn::ShiftLeft<kShift>(widen(half_of<half.value>(pair)));
        const V64 third_at = hn::ShiftLeft<kShift>(widen(half_of<half.value>(third)));
        two[half] = load(begin, pair_at, 0);
        one[half] = load(begin, third_at, kHalf ? 0 : 4);
        seen = hn::Or3(seen, two[half], one[half]);
        if constexpr (kHalf) {
          const auto put = [&](std::size_t e, V64 v) {
            store_or(add, hn::BitCast(du64, v), du64,
                     &samples.rgba16f[3 * c + e][k + half * hn::Lanes(d)]);
          };
          const V64 second = load(begin, pair_at, -8);
          put(0, two[half]), put(1, second), put(2, one[half]);
          seen = hn::Or(seen, second);
        }
      });
      if constexpr (!kHalf) {
        store_or(add, lower_bits(two), du, &samples.rgba8[3 * c][k]);
        store_or(add, upper_bits(two), du, &samples.rgba8[3 * c + 1][k]);
        store_or(add, upper_bits(one), du, &samples.rgba8[3 * c + 2][k]);
      }
      if constexpr (kDepth) {
        if (!add && hn::AllTrue(d, hn::Eq(seen, hn::Zero(d)))) {  // nothing is visible
          clear_words(&samples.depth[c][k], 1);
          continue;
        }
        for_halves([&](auto half) {  // of the 8 bytes loaded: the pair's last two, the third's last
          const V64 begin = hn::LoadU(d, &offsets.depth[c][k + half * hn::Lanes(d)]);
          const auto load_at = [&](VU at, int before) {
            return hn::BitCast(du64, load(begin, widen(half_of<half.value>(at)), before));
          };
          two[half] = hn::BitCast(
              d, hn::Or(hn::ShiftRight<48>(load_at(pair, 6)),
                        hn::And(hn::ShiftRight<40>(load_at(third, 7)), hn::Set(du64, 0xFF0000))));
        });
        store_or(add, lower_bits(two), du, &samples.depth[c][k]);
      }
    }
  }
}

/// Gathers the colours of the vertices next to exit cells.
template <bool kHalf>
void gather_next(const TileOffsets& offsets, const Pass& pass, const EntryCells& entries,
                 std::size_t count, bool add, BlockSamples& samples) {
  const D64 d;
  const DU du;
  const hn::RebindToUnsigned<D64> du64;
  constexpr int kShift = kHalf ? 3 : 2;  // to bytes
  for (std::size_t slot = 0; slot < 6 * pass.entries; ++slot) {
    const std::size_t c = slot / 6;
    const auto& next = pass.exit[c]->next[slot % 6];
    for (std::size_t k = 0; k < count; k += hn::Lanes(du)) {
      const VU column = hn::LoadU(du, &next[k]);
      const VU outside = hn::VecFromMask(du, hn::Eq(column, hn::Set(du, kOutside)));
      const VU at = hn::Add(hn::LoadU(du, &entries.row_begin[c][k]), column);
      V64 colors[kHalves];
      for_halves([&](auto half) {
        const V64 begin = hn::LoadU(d, &offsets.color[c][k + half * hn::Lanes(d)]);
        const V64 bytes = hn::ShiftLeft<kShift>(widen(half_of<half.value>(at)));
        const auto exists = hn::Eq(widen(half_of<half.value>(outside)), hn::Zero(d));
        colors[half] = load(hn::IfThenElseZero(exists, begin), bytes, kHalf ? 0 : 4);
        if constexpr (kHalf)
          store_or(add, hn::BitCast(du64, colors[half]), du64,
                   &samples.next_rgba16f[slot][k + half * hn::Lanes(d)]);
      });
      if constexpr (!kHalf) store_or(add, upper_bits(colors), du, &samples.next_rgba8[slot][k]);
    }
  }
}

void gather_samples_any(const TileOffsets& offsets, const Pass& pass, const EntryCells& entries,
                        std::size_t count, bool half_floats, bool add, BlockSamples& samples) {
  const auto typed =
      half_floats ? (pass.with_depth ? gather_typed<true, true> : gather_typed<true, false>)
                  : (pass.with_depth ? gather_typed<false, true> : gather_typed<false, false>);
  typed(offsets, pass, entries, count, add, samples);
  if (pass.cubic)
    (half_floats ? gather_next<true> : gather_next<false>)(offsets, pass, entries, count, add,
                                                           samples);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(find_tiles_any);
HWY_EXPORT(gather_samples_any);

void find_tiles(const Pass& pass, const EntryCells& entries, std::size_t count, BlockTiles& tiles,
                TileOffsets& offsets) {
  HWY_DYNAMIC_DISPATCH(find_tiles_any)(pass, entries, count, tiles, offsets);
}

void gather_samples(const TileOffsets& offsets, const Pass& pass, const EntryCells& entries,
                    std::size_t count, bool half_floats, bool add, BlockSamples& samples) {
  HWY_DYNAMIC_DISPATCH(gather_samples_any)
  (offsets, pass, entries, count, half_floats, add, samples);
}

}  // namespace slf
#endif  // HWY_ONCE
