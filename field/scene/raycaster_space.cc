#include "field/scene/raycaster_space.h"

#include <algorithm>
#include <limits>

#include "field/volume/voxels.h"

namespace slf {
namespace {

/// Decides which boxes of voxels can be visible.
template <class T>
class Visibility {
 public:
  Visibility(const RayGrid& grid, std::span<const T> voxels) : grid_(grid), voxels_(voxels) {
    const std::vector<float>& opacities = grid.table.opacities;
    // No structure is more opaque than the first row of the table.
    visible_below_.assign(grid.table.entries + 1, 0);
    for (std::size_t k = 0; k < grid.table.entries; ++k)
      visible_below_[k + 1] = visible_below_[k] + (opacities[k] > 0 ? 1 : 0);
  }

  /// Whether a cell whose voxels are within these closed ranges can be visible.
  [[nodiscard]] bool operator()(glm::ivec3 first, glm::ivec3 last) const {
    T low = std::numeric_limits<T>::max(), high = std::numeric_limits<T>::lowest();
    bool labelled = false, shown = grid_.rows.empty();
    for (int z = first.z; z <= last.z; ++z)
      for (int y = first.y; y <= last.y; ++y) {
        const T* row =
            voxels_.data() + (static_cast<std::size_t>(z) * grid_.dims[1] + y) * grid_.dims[0];
        for (int x = first.x; x <= last.x; ++x) {
          low = std::min(low, row[x]);
          high = std::max(high, row[x]);
          if (!shown) shown = grid_.visible_rows[grid_.rows[row - voxels_.data() + x]] != 0;
          if (grid_.labels) labelled |= shows(static_cast<std::size_t>(row[x]));
        }
      }
    if (!shown) return false;
    if (grid_.labels) return labelled;
    // One entry more on each side, for rounding.
    const std::int64_t end = static_cast<std::int64_t>(grid_.table.entries) - 1;
    const auto from = std::clamp<std::int64_t>(entry(low) - 1, 0, end);
    const auto to = std::clamp<std::int64_t>(entry(high) + 1, 0, end);
    return visible_below_[static_cast<std::size_t>(to) + 1] >
           visible_below_[static_cast<std::size_t>(from)];
  }

 private:
  [[nodiscard]] bool shows(std::size_t label) const {
    return label < grid_.table.opacities.size() && grid_.table.opacities[label] > 0;
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

glm::ivec3 last_voxel(const RayGrid& grid) {
  return {grid.dims[0] - 1, grid.dims[1] - 1, grid.dims[2] - 1};
}

/// 0 for each brick with a cell that can be visible, 255 for all others.
template <class T>
std::vector<std::uint8_t> find_visible_bricks(const RayGrid& grid, const Visibility<T>& visible) {
  std::vector<std::uint8_t> bricks(
      static_cast<std::size_t>(grid.bricks[0]) * grid.bricks[1] * grid.bricks[2], 255);
  for_each_brick(grid, [&](glm::ivec3 at, std::size_t number) {
    const glm::ivec3 first = at * kBrick;
    if (visible(first, glm::min(first + kBrick, last_voxel(grid)))) bricks[number] = 0;
  });
  return bricks;
}

/// Chebyshev distance to the nearest brick that is 0, at most 255. Computed by two sweeps of the
/// 3×3×3 neighbourhood.
void spread_distance(std::vector<std::uint8_t>& bricks, const std::array<std::int32_t, 3>& size) {
  const std::int32_t nx = size[0], ny = size[1], nz = size[2];  // clang 14 captures no bindings
  const auto at = [&](int x, int y, int z) -> std::uint8_t& {
    return bricks[(static_cast<std::size_t>(z) * ny + y) * nx + x];
  };
  const auto relax = [&](int x, int y, int z, int sign) {
    int best = at(x, y, z);
    for (int k = 0; k < 13; ++k) {  // the half of the neighbourhood already swept
      const int dx = k % 3 - 1, dy = k / 3 % 3 - 1, dz = k / 9 - 1;
      const int qx = x + sign * dx, qy = y + sign * dy, qz = z + sign * dz;
      if (qx < 0 || qy < 0 || qz < 0 || qx >= nx || qy >= ny || qz >= nz) continue;
      best = std::min(best, at(qx, qy, qz) + 1);
    }
    at(x, y, z) = static_cast<std::uint8_t>(best);
  };
  for (int z = 0; z < nz; ++z)
    for (int y = 0; y < ny; ++y)
      for (int x = 0; x < nx; ++x) relax(x, y, z, 1);
  for (int z = nz; z-- > 0;)
    for (int y = ny; y-- > 0;)
      for (int x = nx; x-- > 0;) relax(x, y, z, -1);
}

/// The first and last visible cell of a row. A box or sphere around all cells depends only on
/// these.
struct CellRun {
  glm::ivec3 first, last;
};

template <class T>
std::vector<CellRun> find_runs(const RayGrid& grid, const Visibility<T>& visible) {
  const auto shows = [&](glm::ivec3 cell) {
    const glm::ivec3 brick = cell >> kBrickShift;
    const std::size_t number =
        (static_cast<std::size_t>(brick.z) * grid.bricks[1] + brick.y) * grid.bricks[0] + brick.x;
    return grid.distance[number] == 0 && visible(cell, cell + 1);
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

/// The sphere around the centre of the visible box up to the farthest visible cell.
Sphere find_bounds(const std::vector<CellRun>& runs, const RayGrid& grid, const Volume& volume) {
  const auto world = [&](const glm::dvec3& index) { return volume.origin + volume.axes * index; };
  Sphere sphere{world((grid.visible_low + grid.visible_high) / 2.0), 0};
  for (const CellRun& run : runs)
    for (int corner = 0; corner < 8; ++corner) {
      const glm::dvec3 at((corner & 1) ? run.last.x + 1 : run.first.x,
                          run.first.y + (corner >> 1 & 1), run.first.z + (corner >> 2));
      sphere.radius = std::max(sphere.radius, glm::distance(sphere.center, world(at)));
    }
  sphere.radius *= 1.001;
  return sphere;
}

}  // namespace

std::optional<Sphere> find_visible_space(const Volume& volume, RayGrid& grid) {
  for (std::size_t axis = 0; axis < 3; ++axis)
    grid.bricks[axis] = (grid.dims[axis] - 1 + kBrick - 1) / kBrick;
  const auto runs = visit_voxels(volume, [&](auto voxels) {
    const Visibility visible(grid, voxels);
    grid.distance = find_visible_bricks(grid, visible);
    return find_runs(grid, visible);
  });
  if (runs.empty()) return std::nullopt;
  find_visible_box(runs, grid);
  spread_distance(grid.distance, grid.bricks);
  return find_bounds(runs, grid, volume);
}

}  // namespace slf
