#include "source/medium/visible_space.h"

#include <algorithm>
#include <limits>

#include "source/volume/voxels.h"

namespace slf {
namespace {

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

  /// Whether a cell whose voxels are within these closed ranges can be visible.
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
    return shows_between(low, high);
  }

  /// Whether the range of its voxels says all about a box: it has no labels and no structures.
  [[nodiscard]] bool by_range() const { return !grid_.labels && grid_.rows.empty(); }
  /// Whether values between these two can be visible.
  [[nodiscard]] bool shows_between(T low, T high) const {
    // One entry more on each side, for rounding.
    const std::int64_t end = static_cast<std::int64_t>(grid_.table.entries) - 1;
    const auto from = std::clamp<std::int64_t>(entry(low) - 1, 0, end);
    const auto to = std::clamp<std::int64_t>(entry(high) + 1, 0, end);
    return visible_below_[static_cast<std::size_t>(to) + 1] >
           visible_below_[static_cast<std::size_t>(from)];
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

/// Calls f with the index of every brick and its number.
template <class F>
void for_each_brick(const RayGrid& grid, const F& f) {
  std::size_t number = 0;
  for (int z = 0; z < grid.bricks[2]; ++z)
    for (int y = 0; y < grid.bricks[1]; ++y)
      for (int x = 0; x < grid.bricks[0]; ++x) f(glm::ivec3(x, y, z), number++);
}

/// Whether planes that clip the volume leave a part of a box. Not if they only touch it.
bool is_kept(const RayGrid& grid, glm::ivec3 first, glm::ivec3 last) {
  const glm::dvec3 half = glm::dvec3(last - first) / 2.0;
  return std::all_of(grid.clip.begin(), grid.clip.end(), [&](const GridPlane& plane) {
    return plane.inside(glm::dvec3(first) + half) + glm::dot(glm::abs(plane.inwards), half) > 1e-6;
  });
}

glm::ivec3 last_voxel(const RayGrid& grid) {
  return {grid.dims[0] - 1, grid.dims[1] - 1, grid.dims[2] - 1};
}

/// The least and greatest voxels of a row of bricks along x, one of each for every column of
/// voxels. Much faster than brick by brick, because it needs no branches.
template <class T>
class ColumnRanges {
 public:
  ColumnRanges(const RayGrid& grid, std::span<const T> voxels) : grid_(grid), voxels_(voxels) {}

  void read(int y_brick, int z_brick) {
    const auto width = static_cast<std::size_t>(grid_.dims[0]);
    low_.assign(width, std::numeric_limits<T>::max());
    high_.assign(width, std::numeric_limits<T>::lowest());
    T *const low = low_.data(), *const high = high_.data();
    const int y_last = std::min(y_brick * kBrick + kBrick, grid_.dims[1] - 1);
    const int z_last = std::min(z_brick * kBrick + kBrick, grid_.dims[2] - 1);
    for (int z = z_brick * kBrick; z <= z_last; ++z)
      for (int y = y_brick * kBrick; y <= y_last; ++y) {
        const T* row = voxels_.data() + number_in(grid_.dims, {0, y, z});
        for (std::size_t x = 0; x < width; ++x) {
          low[x] = std::min(low[x], row[x]);
          high[x] = std::max(high[x], row[x]);
        }
      }
  }
  /// The range of a brick of the row that was read.
  [[nodiscard]] std::pair<T, T> range(int x_brick) const {
    const int first = x_brick * kBrick, last = std::min(first + kBrick, grid_.dims[0] - 1);
    return {*std::min_element(low_.begin() + first, low_.begin() + last + 1),
            *std::max_element(high_.begin() + first, high_.begin() + last + 1)};
  }

 private:
  const RayGrid& grid_;
  std::span<const T> voxels_;
  std::vector<T> low_, high_;
};

/// 0 for each brick with a cell that can be visible, 255 for all others.
template <class T>
std::vector<std::uint8_t> find_visible_bricks(const RayGrid& grid, std::span<const T> voxels,
                                              const Visibility<T>& visible) {
  std::vector<std::uint8_t> bricks(
      static_cast<std::size_t>(grid.bricks[0]) * grid.bricks[1] * grid.bricks[2], 255);
  ColumnRanges<T> columns(grid, voxels);
  for_each_brick(grid, [&](glm::ivec3 at, std::size_t number) {
    if (visible.by_range() && at.x == 0) columns.read(at.y, at.z);
    const glm::ivec3 first = at * kBrick;
    const glm::ivec3 last = glm::min(first + kBrick, last_voxel(grid));
    if (!is_kept(grid, first, last)) return;
    if (visible.by_range()) {
      const auto [low, high] = columns.range(at.x);
      if (visible.shows_between(low, high)) bricks[number] = 0;
      return;
    }
    if (visible(first, last)) bricks[number] = 0;
  });
  return bricks;
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

/// The first and last visible cell of a row. A box or sphere around all cells depends only on
/// these.
struct CellRun {
  glm::ivec3 first, last;
};

/// The bits of RayGrid::visible_cells.
template <class T>
std::vector<std::uint8_t> find_visible_cells(const RayGrid& grid, const Visibility<T>& visible) {
  std::vector<std::uint8_t> cells(grid.distance.size(), 0);
  for_each_brick(grid, [&](glm::ivec3 at, std::size_t number) {
    if (grid.distance[number] > 0) return;
    for (int k = 0; k < kBrick * kBrick * kBrick; ++k) {
      const glm::ivec3 cell = at * kBrick + glm::ivec3(k & 1, k >> 1 & 1, k >> 2);
      if (glm::all(glm::lessThan(cell, last_voxel(grid))) && is_kept(grid, cell, cell + 1) &&
          visible(cell, cell + 1))
        cells[number] |= static_cast<std::uint8_t>(1 << k);
    }
  });
  return cells;
}

std::vector<CellRun> find_runs(const RayGrid& grid) {
  static_assert(kBrick == 2);
  const auto shows = [&](glm::ivec3 cell) {
    const glm::ivec3 brick = cell >> kBrickShift;
    return (grid.visible_cells[number_in(grid.bricks, brick)] >>
                ((cell.x & 1) | (cell.y & 1) << 1 | (cell.z & 1) << 2) &
            1) != 0;
  };
  std::vector<CellRun> runs;
  for (int z = 0; z < grid.dims[2] - 1; ++z)
    for (int y = 0; y < grid.dims[1] - 1; ++y) {
      int first = 0, last = grid.dims[0] - 2;
      while (first <= last && !shows({first, y, z})) ++first;
      if (first > last) continue;
      while (!shows({last, y, z})) --last;
      runs.push_back({{first, y, z}, {last, y, z}});
    }
  return runs;
}

void find_visible_box(const std::vector<CellRun>& runs, RayGrid& grid) {
  grid.visible_low = runs.front().first;
  grid.visible_high = runs.front().last;
  for (const CellRun& run : runs) {
    grid.visible_low = glm::min(grid.visible_low, glm::dvec3(run.first));
    grid.visible_high = glm::max(grid.visible_high, glm::dvec3(run.last + 1));
  }
}

double find_reach(const std::vector<CellRun>& runs, const Volume& volume, const glm::dvec3& from) {
  double reach = 0;
  for (const CellRun& run : runs)
    for (int corner = 0; corner < 8; ++corner) {
      const glm::dvec3 at((corner & 1) ? run.last.x + 1 : run.first.x,
                          run.first.y + (corner >> 1 & 1), run.first.z + (corner >> 2));
      reach = std::max(reach, glm::distance(from, volume.origin + volume.axes * at));
    }
  return reach * 1.001;
}

}  // namespace

std::optional<Sphere> find_visible_space(const Volume& volume, RayGrid& grid, bool may_be_empty) {
  for (std::size_t axis = 0; axis < 3; ++axis)
    grid.bricks[axis] = (grid.dims[axis] - 1 + kBrick - 1) / kBrick;
  auto runs = visit_voxels(volume, [&](auto voxels) {
    const Visibility visible(grid, voxels);
    grid.distance = find_visible_bricks(grid, voxels, visible);
    grid.visible_cells = find_visible_cells(grid, visible);
    return find_runs(grid);
  });
  if (runs.empty()) {
    if (!may_be_empty) return std::nullopt;
    const glm::ivec3 middle = (last_voxel(grid) - 1) / 2;
    runs.push_back({middle, middle});
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
