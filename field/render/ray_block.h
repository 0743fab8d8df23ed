// RayBlock: the rays of a block of pixels, and the data that the renderer's stages compute for
// them. Private to field/render.
//
// Everything is a structure of arrays, so that the kernels process as many rays at a time as the
// machine has lanes. Lanes do not mix: a ray's result depends on the ray alone, never on its place
// in a block. Arrays are longer than the block by kRayPadding: kernels work in whole vectors, and
// values after the last ray are unspecified.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <new>
#include <vector>

namespace slf {

/// Size of a block in pixels. The data of larger blocks would not fit the core's first-level cache.
/// Blocks are flat because each row of a picture is in another page of memory.
inline constexpr std::uint32_t kBlockWidth = 32, kBlockHeight = 4;
inline constexpr std::size_t kBlockRays = kBlockWidth * kBlockHeight;

/// At least the lanes of any target.
inline constexpr std::size_t kRayPadding = 64;

/// Aligns arrays to cache lines, so that a vector never spans two.
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

/// A number for each ray of a block. Moving one moves a pointer.
template <class T>
struct RayArray : std::vector<T, LineAllocator<T>> {
  RayArray() : std::vector<T, LineAllocator<T>>(kBlockRays + kRayPadding) {}
};

/// Points on (or in) the unit sphere.
struct PointArrays {
  RayArray<float> x, y, z;
};

/// Rays that cross the plenoptic sphere, in coordinates where that is the unit sphere around the
/// origin.
struct RayBlock {
  std::size_t count = 0;
  PointArrays enter, leave;
  RayArray<std::uint32_t> pixel;  ///< index in the picture
};

/// The cell of the entry lattice that each ray enters through: three vertices, or only the nearest
/// one, in slot 0.
struct EntryCells {
  std::array<RayArray<std::uint32_t>, 3> section;    ///< the owner of the vertex
  std::array<RayArray<std::uint32_t>, 3> row_begin;  ///< the first sample of its row in a tile
  std::array<RayArray<float>, 3> weight;
  std::array<PointArrays, 3> point;  ///< the vertices' positions; only if requested
};

/// The ordered pairs (i, j) of a cell's vertices.
inline constexpr std::array<std::array<std::size_t, 2>, 6> kVertexPairs{
    {{0, 1}, {1, 0}, {0, 2}, {2, 0}, {1, 2}, {2, 1}}};

/// Instead of the column of a vertex that is not in the cell's section.
inline constexpr std::uint32_t kOutside = ~0u;

/// The cell of the exit lattice around one exit point per ray. Two of its three vertices are
/// neighbours in a row of samples: one load reads both.
struct ExitCells {
  RayArray<std::uint32_t> section;
  RayArray<std::uint32_t> pair;           ///< column of the first; the second comes next
  RayArray<std::uint32_t> third;          ///< column of the third, never the row's first
  std::array<RayArray<float>, 3> weight;  ///< 1, 0, 0 in some order if only the nearest counts
  /// [pair of kVertexPairs]: column of the next vertex on the line from j through i, or kOutside;
  /// only if requested.
  std::array<RayArray<std::uint32_t>, 6> next;
};

/// The samples of each ray, as stored: for each entry vertex an entry sample, the values at the
/// three vertices of its exit cell. Only one of the two kinds of colour is used. `next` samples are
/// those at ExitCells::next, [6 × entry vertex + pair], 0 outside; only of a cubic pass.
struct BlockSamples {
  std::array<RayArray<std::uint32_t>, 9> rgba8;    ///< [3 × entry vertex + exit vertex], r lowest
  std::array<RayArray<std::uint64_t>, 9> rgba16f;  ///< the same
  std::array<RayArray<std::uint32_t>, 18> next_rgba8;
  std::array<RayArray<std::uint64_t>, 18> next_rgba16f;
  std::array<RayArray<std::uint32_t>, 3> depth;  ///< [entry vertex]: a byte per exit vertex
};

/// Depths along each ray, 0 where it enters the sphere and 1 where it leaves, as estimated from its
/// samples. Stored depths are fractions of the chord from the entry vertex instead (FORMAT.md 4.3);
/// blend() converts them.
struct DepthEstimates {
  RayArray<float> t;                    ///< opacity-weighted mean over all samples
  std::array<RayArray<float>, 3> aim;   ///< the depth at which each entry vertex aims
  std::array<RayArray<float>, 3> next;  ///< and in the next round
  RayArray<float> step;                 ///< the largest move of an aim; 0: converged
  RayArray<float> contrast;             ///< the largest range of R, G or B among the samples, of 1
};

/// One run of a block of rays through gather and blend, or bend. The modes without depth have one
/// pass. Mode depth has a first one, up to three rounds, and a cubic one (depth_refinement.h).
struct Pass {
  unsigned entries = 3;        ///< entry vertices in use: 3, or 1 for the nearest alone
  bool with_depth = false;     ///< depths are sampled and estimated
  bool first_of_more = false;  ///< pixels that a later pass will draw need not be drawn
  /// Difference of depth, as a fraction of the ray, at which a sample's weight reaches its minimum.
  /// 0: weights do not depend on depth.
  float depth_tolerance = 0;
  /// Pixels of rays whose step is greater become a mean with those of the pass before.
  float mean_above = std::numeric_limits<float>::infinity();
  /// The pass samples the same exit points again, and the vertices next to their cells. It adds to
  /// the pixels what a cubic between exit vertices differs from linear interpolation.
  bool cubic = false;
  /// Where each entry vertex is sampled: points on the exit side, and their cells. Views of arrays
  /// that stay unchanged during the pass.
  std::array<const PointArrays*, 3> exit_point{};
  std::array<const ExitCells*, 3> exit{};
};

}  // namespace slf
