#include "source/medium/visible_space.h"

#include <algorithm>
#include <array>
#include <limits>

#include "source/medium/column_ranges.h"
#include "source/volume/voxels.h"

namespace slf {
namespace {

/// Whether any of some values can be visible, and whether all can.
struct Shows {
  bool any, all;
};

/// Decides which boxes of voxels can be visible.
template <class T>
class Visibility {
 public:
  Visibility(const RayGrid& grid, std::span<const T> voxels) : grid_(grid), voxels_(voxels) {
    // No structure is more opaque than the first row of the table.
    visible_below_.assign(grid.table.entries + 1, 0);
    for (std::size_t k = 0; k < grid.table.entries; ++k)
      visible_below_[k + 1] = visible_below_[k] + (grid.table.extinctions[k] > 0 ? 1 : 0);
  }

  /// Whether cells whose voxels are within these closed ranges can be visible.
  [[nodiscard]] bool operator()(glm::ivec3 first, glm::ivec3 last) const {
    T low = std::numeric_limits<T>::max(), high = std::numeric_limits<T>::lowest();
    bool labelled = false, shown = grid_.rows.empty();
    for (int z = first.z; z <= last.z; ++z)
      for (int y = first.y; y <= last.y; ++y) {
        const T* row = voxels_.data() + number_in(grid_.dims, {0, y, z});
        for (int x = first.x; x <= last.x; ++x) {
          low = std::min(low, row[x]);
          high = std::max(high, row[x]);
          if (!shown) shown = grid_.visible_rows[grid_.rows[row - voxels_.data() + x]] != 0;
          if (grid_.labels) labelled |= shows(static_cast<std::size_t>(row[x]));
        }
      }
    if (!shown) return false;
    if (grid_.labels) return labelled;
    return shows_between({low, high}).any;
  }

  /// Whether the range of its voxels says all about a box: it has no labels and no structures.
  [[nodiscard]] bool by_range() const { return !grid_.labels && grid_.rows.empty(); }
  /// Of the values between these two.
  [[nodiscard]] Shows shows_between(const std::pair<T, T>& range) const {
    // One entry more on each side, for rounding.
    const std::int64_t end = static_cast<std::int64_t>(grid_.table.entries) - 1;
    const auto from = std::clamp<std::int64_t>(entry(range.first) - 1, 0, end);
    const auto to = std::clamp<std::int64_t>(entry(range.second) + 1, 0, end) + 1;
    const std::int64_t visible = std::int64_t{visible_below_[static_cast<std::size_t>(to)]} -
                                 visible_below_[static_cast<std::size_t>(from)];
    return {visible > 0, visible == to - from};
  }

 private:
  [[nodiscard]] bool shows(std::size_t label) const {
    return label < grid_.table.extinctions.size() && grid_.table.extinctions[label] > 0;
  }
  [[nodiscard]] std::int64_t entry(T voxel) const {
    const TransferTable& table = grid_.table;
    const auto value = static_cast<float>(voxel);
    if (table.logarithmic)
      return (std::int64_t{ordered_bits(value)} - table.low_key) >> table.shift;
    // Truncated, as the kernel does. NOLINTNEXTLINE(bugprone-incorrect-roundings)
    return static_cast<std::int64_t>((value - table.low) * table.scale + 0.5f);
  }

  const RayGrid& grid_;
  std::span<const T> voxels_;
  std::vector<std::uint32_t> visible_below_;  // [k]: how many of the first k entries are visible
};

/// Whether planes that clip the volume leave a part of a box. Not if they only touch it.
bool is_kept(const RayGrid& grid, glm::ivec3 first, glm::ivec3 last) {
  if (grid.clip.empty()) return true;
  const glm::dvec3 half = glm::dvec3(last - first) / 2.0;
  return std::all_of(grid.clip.begin(), grid.clip.end(), [&](const GridPlane& plane) {
    return plane.inside(glm::dvec3(first) + half) + glm::dot(glm::abs(plane.inwards), half) > 1e-6;
  });
}

glm::ivec3 last_voxel(const RayGrid& grid) {
  return {grid.dims[0] - 1, grid.dims[1] - 1, grid.dims[2] - 1};
}

/// The voxels of a cube of 2^shift cells.
struct Block {
  glm::ivec3 first, last;  // closed range
};
Block block(const RayGrid& grid, glm::ivec3 number, int shift) {
  const glm::ivec3 first = number << shift;
  return {first, glm::min(first + (1 << shift), last_voxel(grid))};
}

/// Sets visible_octants, and `distance` to 0 for bricks that can be visible and 255 for all others.
template <class T>
void find_visible_bricks(std::span<const T> voxels, unsigned threads, RayGrid& grid) {
  const Visibility visible(grid, voxels);
  const int half = grid.brick_shift - 1;
  const auto count = static_cast<std::size_t>(grid.bricks[0]) * grid.bricks[1] * grid.bricks[2];
  grid.distance.assign(count, 255);
  grid.visible_octants.assign(count, 0);
  for_each_slice(grid, threads, [&](int z) {
    ColumnRanges<T> bricks(grid, voxels, grid.brick_shift);
    std::vector<ColumnRanges<T>> octants(4, {grid, voxels, half});
    for (int y = 0; y < grid.bricks[1]; ++y) {
      if (visible.by_range()) bricks.read(y, z);
      bool octants_read = !visible.by_range();
      for (int x = 0; x < grid.bricks[0]; ++x) {
        // Most bricks need no more than this.
        Shows shows{true, false};
        if (visible.by_range()) shows = visible.shows_between(bricks.range(x));
        if (!shows.any) continue;
        const glm::ivec3 at(x, y, z);
        const auto [first, last] = block(grid, at, grid.brick_shift);
        if (!is_kept(grid, first, last) || !(visible.by_range() || visible(first, last))) continue;
        const std::size_t number = number_in(grid.bricks, at);
        grid.distance[number] = 0;
        if (shows.all && grid.clip.empty() && last - first == glm::ivec3(1 << grid.brick_shift)) {
          grid.visible_octants[number] = 0xFF;
          continue;
        }
        for (int k = 0; k < 4 && !octants_read; ++k)
          octants[static_cast<std::size_t>(k)].read(2 * y + (k & 1), 2 * z + (k >> 1));
        octants_read = true;
        for (int k = 0; k < 8; ++k) {
          const glm::ivec3 place(k & 1, k >> 1 & 1, k >> 2);
          const glm::ivec3 from = first + (place << half), to = glm::min(from + (1 << half), last);
          if (!glm::all(glm::lessThan(from, to)) || !is_kept(grid, from, to)) continue;
          const auto& row = octants[static_cast<std::size_t>(k >> 1)];
          if (visible.by_range() ? visible.shows_between(row.range(2 * x + place.x)).any
                                 : visible(from, to))
            grid.visible_octants[number] |= static_cast<std::uint8_t>(1 << k);
        }
      }
    }
  });
}

/// Chebyshev distance to the nearest brick that is 0, at most 255. Computed by two sweeps of the
/// 3×3×3 neighbourhood.
void spread_distance(std::vector<std::uint8_t>& bricks, const std::array<std::int32_t, 3>& size) {
  // A border of the greatest distance, so that all bricks have all neighbours.
  const std::ptrdiff_t row = size[0] + 2, slice = row * (size[1] + 2);
  std::vector<std::uint8_t> padded(static_cast<std::size_t>(slice * (size[2] + 2)), 255);
  const auto first_of = [&](int y, int z) {
    return padded.data() + (z + 1) * slice + (y + 1) * row + 1;
  };
  const auto for_each_row = [&](const auto& f) {
    auto from = bricks.begin();
    for (int z = 0; z < size[2]; ++z)
      for (int y = 0; y < size[1]; ++y, from += size[0]) f(from, first_of(y, z));
  };
  for_each_row([&](auto from, std::uint8_t* to) { std::copy_n(from, size[0], to); });

  std::array<std::ptrdiff_t, 13> before;  // the half of the neighbourhood already swept
  for (int k = 0; k < 13; ++k)
    before[static_cast<std::size_t>(k)] = (k / 9 - 1) * slice + (k / 3 % 3 - 1) * row + k % 3 - 1;
  const auto relax = [&](std::uint8_t* brick, int sign) {
    int nearest = 254;
    for (const std::ptrdiff_t neighbour : before)
      nearest = std::min<int>(nearest, brick[sign * neighbour]);
    *brick = static_cast<std::uint8_t>(std::min<int>(*brick, nearest + 1));
  };
  for (int z = 0; z < size[2]; ++z)
    for (int y = 0; y < size[1]; ++y)
      for (int x = 0; x < size[0]; ++x) relax(first_of(y, z) + x, 1);
  for (int z = size[2]; z-- > 0;)
    for (int y = size[1]; y-- > 0;)
      for (int x = size[0]; x-- > 0;) relax(first_of(y, z) + x, -1);
  for_each_row([&](auto to, const std::uint8_t* from) { std::copy_n(from, size[0], to); });
}

/// The voxels of the first and last visible octant of a row. A box or sphere around all depends
/// only on these.
using OctantRun = Block;

std::vector<OctantRun> find_runs(const RayGrid& grid) {
  const auto shows = [&](glm::ivec3 octant) {
    const std::uint8_t bits = grid.visible_octants[number_in(grid.bricks, octant >> 1)];
    return (bits >> ((octant.x & 1) | (octant.y & 1) << 1 | (octant.z & 1) << 2) & 1) != 0;
  };
  std::vector<OctantRun> runs;
  for (int z = 0; z < 2 * grid.bricks[2]; ++z)
    for (int y = 0; y < 2 * grid.bricks[1]; ++y) {
      int first = 0, last = 2 * grid.bricks[0] - 1;
      while (first <= last && !shows({first, y, z})) ++first;
      if (first > last) continue;
      while (!shows({last, y, z})) --last;
      const int half = grid.brick_shift - 1;
      runs.push_back(
          {block(grid, {first, y, z}, half).first, block(grid, {last, y, z}, half).last});
    }
  return runs;
}

void find_visible_box(const std::vector<OctantRun>& runs, RayGrid& grid) {
  grid.visible_low = runs.front().first;
  grid.visible_high = runs.front().last;
  for (const OctantRun& run : runs) {
    grid.visible_low = glm::min(grid.visible_low, glm::dvec3(run.first));
    grid.visible_high = glm::max(grid.visible_high, glm::dvec3(run.last));
  }
}

double find_reach(const std::vector<OctantRun>& runs, const Volume& volume,
                  const glm::dvec3& from) {
  double reach = 0;
  for (const OctantRun& run : runs)
    for (int corner = 0; corner < 8; ++corner) {
      const glm::bvec3 end(corner & 1, corner >> 1 & 1, corner >> 2);
      const glm::dvec3 at(glm::mix(run.first, run.last, end));
      reach = std::max(reach, glm::distance(from, volume.origin + volume.axes * at));
    }
  return reach * 1.001;
}

}  // namespace

std::optional<Sphere> find_visible_space(const Volume& volume, RayGrid& grid, bool may_be_empty,
                                         unsigned threads, std::uint64_t max_bricks) {
  for (grid.brick_shift = 1;; ++grid.brick_shift) {
    std::uint64_t count = 1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      grid.bricks[axis] = ((grid.dims[axis] - 2) >> grid.brick_shift) + 1;
      count *= static_cast<std::uint64_t>(grid.bricks[axis]);
    }
    if (count <= max_bricks) break;
  }
  visit_voxels(volume, [&](auto voxels) { find_visible_bricks(voxels, threads, grid); });
  auto runs = find_runs(grid);
  if (runs.empty()) {
    if (!may_be_empty) return std::nullopt;
    const glm::ivec3 middle = (last_voxel(grid) - 1) / 2;
    runs.push_back({middle, middle + 1});
  }
  spread_distance(grid.distance, grid.bricks);
  find_visible_box(runs, grid);
  const glm::dvec3 middle = (grid.visible_low + grid.visible_high) / 2.0;
  const glm::dvec3 center = volume.origin + volume.axes * middle;
  return Sphere{center, find_reach(runs, volume, center)};
}

double find_reach(const Volume& volume, const RayGrid& grid, const glm::dvec3& from) {
  return find_reach(find_runs(grid), volume, from);
}

}  // namespace slf
