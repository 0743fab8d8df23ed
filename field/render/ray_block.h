// RayBlock: the rays of a block of pixels on their way through the renderer. Private to field/.
//
// Everything is a structure of arrays, so that the kernel takes as many rays at a time as the
// machine has lanes. Arrays are longer than the block by kRayPadding: the kernel works in whole
// vectors, and what it leaves behind the last ray means nothing.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <new>
#include <vector>

#include "field/render/tile_numbers.h"

namespace slf {

/// Blocks of pixels. Larger ones leave the core's first cache, and each row is another page of
/// memory.
inline constexpr std::uint32_t kBlockWidth = 32, kBlockHeight = 4;
inline constexpr std::size_t kBlockRays = kBlockWidth * kBlockHeight;

/// At least the lanes of any target.
inline constexpr std::size_t kRayPadding = 64;

/// Whole vectors lie in one cache line each.
template <class T>
struct LineAllocator {
  using value_type = T;
  static constexpr std::align_val_t kLine{64};

  LineAllocator() = default;
  template <class U>
  explicit LineAllocator(const LineAllocator<U>&) {}
  T* allocate(std::size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), kLine)); }
  void deallocate(T* from, std::size_t) { ::operator delete(from, kLine); }
  friend bool operator==(const LineAllocator&, const LineAllocator&) { return true; }
};

template <class T>
using RayArray = std::vector<T, LineAllocator<T>>;

/// Points on (or in) the unit sphere.
struct PointArrays {
  RayArray<float> x, y, z;

  void resize(std::size_t size) {
    for (auto* axis : {&x, &y, &z}) axis->resize(size);
  }
};

/// Rays that cross the plenoptic sphere, in coordinates where that is the unit sphere around the
/// origin.
struct RayBlock {
  std::size_t count = 0;
  PointArrays enter, leave;
  RayArray<std::uint32_t> pixel;  ///< index in the picture

  void resize(std::size_t size) {
    enter.resize(size + kRayPadding);
    leave.resize(size + kRayPadding);
    pixel.resize(size + kRayPadding);
  }
};

/// Each ray's entry vertices: three, or in slot 0 the nearest alone.
struct EntryArrays {
  std::array<RayArray<std::uint32_t>, 3> section;  ///< that owns the vertex
  std::array<RayArray<std::uint32_t>, 3> row;      ///< its first sample in the section's tiles
  std::array<RayArray<float>, 3> weight;
  std::array<RayArray<float>, 3> t;  ///< depth along the ray that the vertex is to aim at
  RayArray<float> step;              ///< how far the furthest of these aims moved; 0: not at all
  std::array<PointArrays, 3> point;  ///< the vertices, where depth is wanted

  void resize(std::size_t size) {
    for (auto* arrays : {&section, &row})
      for (auto& array : *arrays) array.resize(size + kRayPadding);
    for (auto& array : weight) array.resize(size + kRayPadding);
    for (auto& array : t) array.resize(size + kRayPadding);
    step.resize(size + kRayPadding);
    for (auto& points : point) points.resize(size + kRayPadding);
  }
};

/// The three exit vertices around one exit point per ray. Two of them are neighbours in a row of
/// samples: one load takes both.
struct ExitArrays {
  RayArray<std::uint32_t> section;
  RayArray<std::uint32_t> pair;           ///< column of the first; the second comes next
  RayArray<std::uint32_t> third;          ///< column of the third, never the row's first
  std::array<RayArray<float>, 3> weight;  ///< 1 for the nearest, where it alone is wanted

  void resize(std::size_t size) {
    for (auto* array : {&section, &pair, &third}) array->resize(size + kRayPadding);
    for (auto& array : weight) array.resize(size + kRayPadding);
  }
};

/// The samples of each ray, as stored. Only one of the two kinds of colour is used.
struct SampleArrays {
  std::array<RayArray<std::uint32_t>, 9> rgba8;    ///< [3 × entry slot + exit], r lowest
  std::array<RayArray<std::uint64_t>, 9> rgba16f;  ///< the same
  std::array<RayArray<std::uint32_t>, 3> depth;    ///< [entry slot]: a byte for each exit

  void resize(std::size_t size, bool half_floats) {
    for (auto& array : rgba8) array.resize(half_floats ? 0 : size + kRayPadding);
    for (auto& array : rgba16f) array.resize(half_floats ? size + kRayPadding : 0);
    for (auto& array : depth) array.resize(size + kRayPadding);
  }
};

/// Which tile, by number, each ray's entry slots sample: kNoTile where its weight is 0.
using TileArrays = std::array<RayArray<std::uint32_t>, 3>;

/// Where the pinned tiles are: bytes from `zeros`, amid zeros for whatever is loaded at once, to a
/// tile's first sample. 0 where nothing is stored or pinned.
struct TileOffsets {
  const std::byte* zeros = nullptr;
  std::vector<std::int64_t> color{0}, depth{0};  ///< [number + 1], so that kNoTile has the first
};

/// A pass over rays: every ray's entry vertices, each aimed at an exit point.
struct Pass {
  unsigned entries = 3;     ///< slots in use
  bool with_depth = false;  ///< depth is wanted
  bool preview = false;     ///< pixels that a further look will draw need not be drawn
  /// Samples count by how well they agree with the depth that was aimed at: fully at the same
  /// place, hardly from this far along the ray. 0: they all count.
  float spread = 0;
  std::array<const PointArrays*, 3> aim{};  ///< per entry slot
  std::array<const ExitArrays*, 3> exit{};
};

}  // namespace slf
