#include "source/medium/medium.h"

#include <cstdint>
#include <cstring>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "source/medium/medium_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr hn::CappedTag<float, std::tuple_size_v<March>> kFloats;
constexpr hn::Rebind<std::int32_t, decltype(kFloats)> kInts;
constexpr hn::Rebind<std::uint32_t, decltype(kFloats)> kWords;
using Floats = hn::Vec<decltype(kFloats)>;
constexpr std::size_t kLanes = hn::MaxLanes(kFloats);

/// The voxels at the corners of cells, in pairs along x: at (y, z) = (0, 0), (1, 0), (0, 1), (1,
/// 1).
template <class T>
struct Corners {
  alignas(64) std::uint32_t pairs[4][kLanes];

  HWY_INLINE void set(int pair, std::size_t lane, const T* voxels) {
    std::conditional_t<sizeof(T) == 1, std::uint16_t, std::uint32_t> word;
    std::memcpy(&word, voxels, sizeof word);
    pairs[pair][lane] = word;
  }
  /// Moves a voxel to the top of its word, and from there, with its sign, to the bottom.
  template <int kUp>
  HWY_INLINE Floats get(int pair) const {
    constexpr int kDown = 32 - 8 * static_cast<int>(sizeof(T));
    const auto top = hn::ShiftLeft<kUp>(hn::Load(kWords, pairs[pair]));
    if constexpr (std::is_signed_v<T>)
      return hn::ConvertTo(kFloats, hn::ShiftRight<kDown>(hn::BitCast(kInts, top)));
    else
      return hn::ConvertTo(kFloats, hn::BitCast(kInts, hn::ShiftRight<kDown>(top)));
  }
  HWY_INLINE Floats first(int pair) const { return get<32 - 8 * sizeof(T)>(pair); }
  HWY_INLINE Floats second(int pair) const { return get<32 - 16 * sizeof(T)>(pair); }
};
template <>
struct Corners<float> {
  alignas(64) float x0[4][kLanes], x1[4][kLanes];

  HWY_INLINE void set(int pair, std::size_t lane, const float* voxels) {
    x0[pair][lane] = voxels[0];
    x1[pair][lane] = voxels[1];
  }
  HWY_INLINE Floats first(int pair) const { return hn::Load(kFloats, x0[pair]); }
  HWY_INLINE Floats second(int pair) const { return hn::Load(kFloats, x1[pair]); }
};

HWY_INLINE Floats lerp(Floats a, Floats b, Floats t) { return hn::MulAdd(t, b - a, a); }

template <class T>
void march_typed(const RayGrid& grid, const float* extinctions, const glm::vec3& from,
                 const glm::vec3& step, float* to) {
  const auto* voxels = reinterpret_cast<const T*>(grid.voxels);
  const std::ptrdiff_t row = grid.dims[0], slice = row * grid.dims[1];
  const Floats zero = hn::Zero(kFloats), one = hn::Set(kFloats, 1.f);
  for (std::size_t i = 0; i < std::tuple_size_v<March>; i += kLanes) {
    const Floats number = hn::Iota(kFloats, static_cast<float>(i));
    alignas(64) std::int32_t cell[3][kLanes];
    Floats within[3];
    for (int axis = 0; axis < 3; ++axis) {
      const Floats at =
          hn::MulAdd(number, hn::Set(kFloats, step[axis]), hn::Set(kFloats, from[axis]));
      const auto last = hn::Set(kInts, grid.dims[axis] - 2);
      const auto first = hn::Max(hn::Zero(kInts), hn::Min(hn::ConvertTo(kInts, at), last));
      hn::Store(first, kInts, cell[axis]);
      within[axis] = hn::Max(zero, hn::Min(at - hn::ConvertTo(kFloats, first), one));
    }
    Corners<T> corners;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const T* corner = voxels + cell[2][lane] * slice + cell[1][lane] * row + cell[0][lane];
      corners.set(0, lane, corner);
      corners.set(1, lane, corner + row);
      corners.set(2, lane, corner + slice);
      corners.set(3, lane, corner + slice + row);
    }
    const auto along = [&](int pair) {
      return lerp(corners.first(pair), corners.second(pair), within[0]);
    };
    const Floats value =
        lerp(lerp(along(0), along(1), within[1]), lerp(along(2), along(3), within[1]), within[2]);
    // As entry_of().
    const auto last = hn::Set(kInts, static_cast<std::int32_t>(grid.table.entries) - 1);
    const Floats place = hn::MulAdd(value - hn::Set(kFloats, grid.table.low),
                                    hn::Set(kFloats, grid.table.scale), hn::Set(kFloats, 0.5f));
    const auto entry = hn::Max(hn::Zero(kInts), hn::Min(hn::ConvertTo(kInts, place), last));
    hn::StoreU(hn::GatherIndex(kFloats, extinctions, entry), kFloats, to + i);
  }
}

void march_any(const RayGrid& grid, const float* extinctions, const glm::vec3& from,
               const glm::vec3& step, float* to) {
  with_grid_type(grid.type, [&]<class T>(T) { march_typed<T>(grid, extinctions, from, step, to); });
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(march_any);

void march(const RayGrid& grid, const std::vector<float>& extinctions, const glm::vec3& from,
           const glm::vec3& step, March& to) {
  HWY_DYNAMIC_DISPATCH(march_any)(grid, extinctions.data(), from, step, to.data());
}

}  // namespace slf
#endif  // HWY_ONCE
