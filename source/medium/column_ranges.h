// The least and greatest voxels of bricks or smaller blocks, and work on all slices of bricks.
// Private to source/medium.
#pragma once

#include <algorithm>
#include <limits>
#include <new>
#include <span>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "source/medium/ray_grid.h"

namespace slf {

/// The least and greatest voxels of a row along x of blocks, which are cubes of 2^shift cells: one
/// of each for every column of voxels. Much faster than block by block, because it needs no
/// branches.
template <class T>
class ColumnRanges {
 public:
  ColumnRanges(const RayGrid& grid, std::span<const T> voxels, int shift)
      : dims_(grid.dims), voxels_(voxels), edge_(1 << shift) {}

  /// Reads the row of these numbers. Without a cell there, no value is in its ranges.
  void read(int y_block, int z_block) {
    const auto width = static_cast<std::size_t>(dims_[0]);
    low_.assign(width, std::numeric_limits<T>::max());
    high_.assign(width, std::numeric_limits<T>::lowest());
    T *const low = low_.data(), *const high = high_.data();
    const int y_first = y_block * edge_, y_last = std::min(y_first + edge_, dims_[1] - 1);
    const int z_first = z_block * edge_, z_last = std::min(z_first + edge_, dims_[2] - 1);
    if (y_first == y_last || z_first == z_last) return;
    for (int z = z_first; z <= z_last; ++z)
      for (int y = y_first; y <= y_last; ++y) {
        const T* row = voxels_.data() + number_in(dims_, {0, y, z});
        for (std::size_t x = 0; x < width; ++x) {
          low[x] = std::min(low[x], row[x]);
          high[x] = std::max(high[x], row[x]);
        }
      }
  }
  /// The range of a block of the row that was read.
  [[nodiscard]] std::pair<T, T> range(int x_block) const {
    const int first = x_block * edge_, last = std::min(first + edge_, dims_[0] - 1);
    T low = low_[static_cast<std::size_t>(first)], high = high_[static_cast<std::size_t>(first)];
    for (int x = first + 1; x <= last; ++x) {
      low = std::min(low, low_[static_cast<std::size_t>(x)]);
      high = std::max(high, high_[static_cast<std::size_t>(x)]);
    }
    return {low, high};
  }

 private:
  std::array<std::int32_t, 3> dims_;
  std::span<const T> voxels_;
  int edge_;
  std::vector<T> low_, high_;
};

/// Calls f(z) for each slice of bricks, on up to `threads` threads (0: all). REQUIRES: f throws
/// nothing but std::bad_alloc. Throws that.
template <class F>
void for_each_slice(const RayGrid& grid, unsigned threads, const F& f) {
  const auto slices = static_cast<std::uint64_t>(grid.bricks[2]);
  if (!parallel_for(slices, threads, [&](std::uint64_t z) { f(static_cast<int>(z)); }))
    throw std::bad_alloc();
}

}  // namespace slf
