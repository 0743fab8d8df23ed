// Loads the voxels around several samples row by row, and transposes them to vectors that hold one
// voxel of each sample. Part of raycaster_kernel.cc.

// Included once per instruction set.
#if defined(SLF_FIELD_RAYCASTER_ROWS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLF_FIELD_RAYCASTER_ROWS_INL_H_
#undef SLF_FIELD_RAYCASTER_ROWS_INL_H_
#else
#define SLF_FIELD_RAYCASTER_ROWS_INL_H_
#endif

#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <type_traits>

#include "source/raycast/raycaster_kernel.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr hn::ScalableTag<float> kFloats;
constexpr hn::ScalableTag<std::int32_t> kInts;
constexpr hn::ScalableTag<std::uint32_t> kWords;
using Floats = hn::Vec<decltype(kFloats)>;
using Ints = hn::Vec<decltype(kInts)>;
constexpr std::size_t kLanes = hn::MaxLanes(kFloats);

/// Vectors of one value; and of kLanes values in memory, which is aligned.
template <class T>
HWY_INLINE Floats floats(T value) {
  return hn::Set(kFloats, static_cast<float>(value));
}
HWY_INLINE Ints ints(std::int32_t value) { return hn::Set(kInts, value); }
HWY_INLINE Floats load(const float* from) { return hn::Load(kFloats, from); }
HWY_INLINE Ints load(const std::int32_t* from) { return hn::Load(kInts, from); }
HWY_INLINE void store(Floats values, float* to) { hn::Store(values, kFloats, to); }
HWY_INLINE void store(Ints values, std::int32_t* to) { hn::Store(values, kInts, to); }

/// Four voxels in a row along x.
template <class T>
struct Row {
  T voxels[4];
};

/// Copies the 4×4×4 voxels around a cell at the border of the volume.
template <class T>
HWY_NOINLINE void copy_clamped(const RayGrid& grid, int x, int y, int z, T* to) {
  const auto* voxels = reinterpret_cast<const T*>(grid.voxels);
  const std::array<int, 3> first{x - 1, y - 1, z - 1};
  std::ptrdiff_t offset[3][4], stride = 1;
  for (std::size_t axis = 0; axis < 3; stride *= grid.dims[axis++])
    for (int k = 0; k < 4; ++k)
      offset[axis][k] = std::clamp(first[axis] + k, 0, grid.dims[axis] - 1) * stride;
  for (const std::ptrdiff_t slice : offset[2])
    for (const std::ptrdiff_t row : offset[1])
      for (const std::ptrdiff_t voxel : offset[0]) *to++ = voxels[slice + row + voxel];
}

/// A row as loaded: voxels or, in label volumes, 1 where the label is visible and 0 elsewhere.
template <class T, bool kLabels>
HWY_INLINE auto take_row(const RayGrid& grid, const T* from) {
  if constexpr (kLabels) {
    Row<std::uint8_t> row;
    for (int x = 0; x < 4; ++x) {
      const auto label = static_cast<std::size_t>(from[x]);
      row.voxels[x] = label < grid.table.extinctions.size() && grid.table.extinctions[label] > 0;
    }
    return row;
  } else {
    Row<T> row;
    std::memcpy(&row, from, sizeof row);
    return row;
  }
}

/// The rows of kLanes cells, transposed: one vector for each of the four columns.
struct Columns {
  Floats x0, x1, x2, x3;
};

template <class T>
HWY_INLINE Columns load_columns(const Row<T>* rows) {
  Columns c;
  if constexpr (std::is_same_v<T, float>) {
    hn::LoadInterleaved4(kFloats, &rows->voxels[0], c.x0, c.x1, c.x2, c.x3);
  } else {
    // Move the k-th voxel of a word to its top, and from there, with its sign, to its bottom.
    constexpr int kDown = 32 - 8 * static_cast<int>(sizeof(T));
    const auto voxel = [&](auto word, auto up) {
      const auto top = hn::ShiftLeft<decltype(up)::value>(word);
      if constexpr (std::is_signed_v<T>)
        return hn::ConvertTo(kFloats, hn::ShiftRight<kDown>(hn::BitCast(kInts, top)));
      else
        return hn::ConvertTo(kFloats, hn::BitCast(kInts, hn::ShiftRight<kDown>(top)));
    };
    using std::integral_constant;
    const auto* words = reinterpret_cast<const std::uint32_t*>(rows);
    if constexpr (sizeof(T) == 1) {
      const auto word = hn::Load(kWords, words);
      c.x0 = voxel(word, integral_constant<int, 24>{});
      c.x1 = voxel(word, integral_constant<int, 16>{});
      c.x2 = voxel(word, integral_constant<int, 8>{});
      c.x3 = voxel(word, integral_constant<int, 0>{});
    } else {
      auto low = hn::Undefined(kWords), high = hn::Undefined(kWords);
      hn::LoadInterleaved2(kWords, words, low, high);
      c.x0 = voxel(low, integral_constant<int, 16>{});
      c.x1 = voxel(low, integral_constant<int, 0>{});
      c.x2 = voxel(high, integral_constant<int, 16>{});
      c.x3 = voxel(high, integral_constant<int, 0>{});
    }
  }
  return c;
}

HWY_INLINE Floats lerp(Floats a, Floats b, Floats t) { return hn::MulAdd(t, b - a, a); }

/// The rows around a cell, of 4×4 in y and z. The value needs the first four, the inner ones,
/// central differences all.
constexpr int kRowY[12] = {1, 2, 1, 2, 0, 0, 3, 3, 1, 2, 1, 2};
constexpr int kRowZ[12] = {1, 1, 2, 2, 1, 2, 1, 2, 0, 0, 3, 3};

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#endif
