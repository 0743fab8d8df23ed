#include "source/medium/medium.h"

#include <hwy/base.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>

#include "slf/tone.h"
#include "source/medium/column_ranges.h"

namespace slf {
namespace {

struct Cell {
  glm::ivec3 first;
  glm::vec3 within;
};

inline Cell cell_of(const RayGrid& grid, const glm::dvec3& at) {
  const glm::ivec3 last(grid.dims[0] - 2, grid.dims[1] - 2, grid.dims[2] - 2);
  const glm::ivec3 first = glm::clamp(glm::ivec3(at), glm::ivec3(0), last);
  return {first, glm::clamp(glm::vec3(at - glm::dvec3(first)), 0.f, 1.f)};
}

/// The `N`³ voxels from `first` on, clamped at the border of the volume; x fastest. Of labels,
/// whether they are visible if `visible`, else the ids.
template <int N>
void load(const RayGrid& grid, const glm::ivec3& first, bool visible, float* to) {
  const glm::ivec3 dims(grid.dims[0], grid.dims[1], grid.dims[2]);
  const bool inside = glm::all(glm::greaterThanEqual(first, glm::ivec3(0))) &&
                      glm::all(glm::lessThanEqual(first + N, dims));
  with_grid_type(grid.type, [&]<class T>(T) {
    const auto* voxels = reinterpret_cast<const T*>(grid.voxels);
    if (inside && !visible) {
      const auto* row = voxels + (std::ptrdiff_t{first.z} * dims.y + first.y) * dims.x + first.x;
      for (int z = 0; z < N; ++z, row += std::ptrdiff_t{dims.y - N} * dims.x)
        for (int y = 0; y < N; ++y, row += dims.x)
          for (int x = 0; x < N; ++x) *to++ = static_cast<float>(row[x]);
      return;
    }
    for (int z = 0; z < N; ++z)
      for (int y = 0; y < N; ++y) {
        const std::ptrdiff_t row =
            (std::ptrdiff_t{std::clamp(first.z + z, 0, dims.z - 1)} * dims.y +
             std::clamp(first.y + y, 0, dims.y - 1)) *
            dims.x;
        for (int x = 0; x < N; ++x) {
          const auto voxel = voxels[row + std::clamp(first.x + x, 0, dims.x - 1)];
          if (visible) {
            // Negative values become numbers beyond the table.
            // NOLINTNEXTLINE(bugprone-signed-char-misuse)
            const auto label = static_cast<std::size_t>(voxel);
            *to++ = label < grid.table.extinctions.size() && grid.table.extinctions[label] > 0;
          } else {
            *to++ = static_cast<float>(voxel);
          }
        }
      }
  });
}

/// Trilinear interpolation of f(corner) over the corners of a cell.
template <class F>
inline auto trilinear(const glm::vec3& w, const F& f) {
  const auto along = [&](int y, int z) { return glm::mix(f(0, y, z), f(1, y, z), w.x); };
  return glm::mix(glm::mix(along(0, 0), along(1, 0), w.y), glm::mix(along(0, 1), along(1, 1), w.y),
                  w.z);
}

/// The value of the volume in a cell.
inline float value_in(const RayGrid& grid, const Cell& cell) {
  const std::ptrdiff_t row = grid.dims[0], slice = row * grid.dims[1];
  const std::ptrdiff_t first = cell.first.z * slice + cell.first.y * row + cell.first.x;
  return with_grid_type(grid.type, [&]<class T>(T) {
    const auto* corner = reinterpret_cast<const T*>(grid.voxels) + first;
    return trilinear(cell.within, [&](int x, int y, int z) {
      return static_cast<float>(corner[z * slice + y * row + x]);
    });
  });
}

}  // namespace

glm::dvec3 uniform_direction(double u, double v) {
  const double z = 1 - 2 * u, r = std::sqrt(std::max(0.0, 1 - z * z));
  return {r * std::cos(2 * std::numbers::pi * v), r * std::sin(2 * std::numbers::pi * v), z};
}

glm::dvec3 cosine_direction(const glm::dvec3& normal, double u, double v) {
  // A uniform point on the unit sphere around the tip of the normal.
  const glm::dvec3 sum = normal + uniform_direction(u, v);
  const double length = glm::length(sum);
  return length > 1e-9 ? sum / length : normal;
}

glm::vec3 albedo_of(const glm::vec3& color) {
  const auto albedo = [](float a) {
    return -std::expm1(a * (-5.09406f + a * (2.61188f - a * 4.31805f)));
  };
  return glm::vec3(albedo(color.r), albedo(color.g), albedo(color.b)) / albedo(1);
}

double Matter::kernel(const glm::dvec3& direction) const {
  return surface * std::max(0.0, glm::dot(normal, direction)) / std::numbers::pi +
         (1 - surface) / (4 * std::numbers::pi);
}

glm::dvec3 Matter::sample(double choice, double u, double v) const {
  return choice < surface ? cosine_direction(normal, u, v) : uniform_direction(u, v);
}

Medium::Medium(const RayGrid& grid, unsigned threads)
    : grid_(grid), index_to_world_(glm::inverse(grid.world_to_index)) {
  for (int axis = 0; axis < 3; ++axis)
    smallest_spacing_ = std::min(smallest_spacing_, glm::length(index_to_world_[axis]));
  for (const float per_spacing : grid.table.extinctions) {
    const double extinction = per_spacing / smallest_spacing_;
    extinctions_.push_back(static_cast<float>(extinction));
    const glm::vec3 color(grid.table.colors[albedos_.size()]);
    albedos_.emplace_back(albedo_of(color), -std::expm1(-2 * smallest_spacing_ * extinction));
  }
  find_majorants(threads);
}

/// The largest extinction over the values of each brick.
void Medium::find_majorants(unsigned threads) {
  // levels[k][i]: the largest of the 2^k entries from i on.
  // No structure is denser than the first row of the table.
  const std::size_t entries = grid_.table.entries;
  std::vector<std::vector<float>> levels{
      {extinctions_.begin(), extinctions_.begin() + static_cast<std::ptrdiff_t>(entries)}};
  for (std::size_t width = 2; width <= entries && !grid_.labels; width *= 2) {
    const std::vector<float>& half = levels.back();
    std::vector<float> level(entries - width + 1);
    for (std::size_t i = 0; i < level.size(); ++i)
      level[i] = std::max(half[i], half[i + width / 2]);
    levels.push_back(std::move(level));
  }
  const std::size_t last = entries - 1;
  const auto max_between = [&](std::size_t from, std::size_t to) {
    from = from > 0 ? from - 1 : 0;  // one entry more on each side, for rounding
    to = std::min(to + 1, last);
    const std::size_t width = std::bit_floor(to - from + 1);
    const std::vector<float>& level = levels[static_cast<std::size_t>(std::countr_zero(width))];
    return std::max(level[from], level[to + 1 - width]);
  };
  majorants_.assign(grid_.distance.size(), 0);
  with_grid_type(grid_.type, [&]<class T>(T) {
    const auto count = static_cast<std::size_t>(grid_.dims[0]) * grid_.dims[1] * grid_.dims[2];
    const std::span voxels(reinterpret_cast<const T*>(grid_.voxels), count);
    const glm::ivec3 last_voxel(grid_.dims[0] - 1, grid_.dims[1] - 1, grid_.dims[2] - 1);
    const auto densest_label = [&](const glm::ivec3& brick) {
      const glm::ivec3 from = brick << grid_.brick_shift;
      const glm::ivec3 to = glm::min(from + (1 << grid_.brick_shift), last_voxel);
      float most = 0;
      for (int z = from.z; z <= to.z; ++z)
        for (int y = from.y; y <= to.y; ++y)
          for (int x = from.x; x <= to.x; ++x)
            if (const auto label =
                    static_cast<std::size_t>(voxels[number_in(grid_.dims, {x, y, z})]);
                label < extinctions_.size())
              most = std::max(most, extinctions_[label]);
      return most;
    };
    for_each_slice(grid_, threads, [&](int z) {
      ColumnRanges<T> row(grid_, voxels, grid_.brick_shift);
      for (int y = 0; y < grid_.bricks[1]; ++y) {
        bool read = false;
        for (int x = 0; x < grid_.bricks[0]; ++x) {
          const std::size_t number = number_in(grid_.bricks, {x, y, z});
          if (grid_.distance[number] > 0) continue;
          if (grid_.labels) {
            majorants_[number] = densest_label({x, y, z});
            continue;
          }
          if (!std::exchange(read, true)) row.read(y, z);
          const auto [low, high] = row.range(x);
          majorants_[number] = max_between(entry_of(grid_.table, static_cast<float>(low)),
                                           entry_of(grid_.table, static_cast<float>(high)));
        }
      }
    });
  });
}

std::size_t Medium::entry(const glm::dvec3& at) const {
  const Cell cell = cell_of(grid_, at);
  if (grid_.labels) {
    float label = 0;
    load<1>(grid_, cell.first + glm::ivec3(glm::step(0.5f, cell.within)), false, &label);
    return std::min(static_cast<std::size_t>(label), extinctions_.size() - 1);
  }
  std::size_t row = 0;
  if (!grid_.rows.empty()) {
    const glm::ivec3 voxel = cell.first + glm::ivec3(glm::step(0.5f, cell.within));
    row = grid_.rows[number_in(grid_.dims, voxel)];
  }
  return row * grid_.table.entries + entry_of(grid_.table, value_in(grid_, cell));
}

float Medium::extinction(const glm::dvec3& at) const { return extinctions_[entry(at)]; }

void Medium::extinctions(const glm::dvec3& from, const glm::dvec3& step, int count,
                         March& to) const {
  if (!grid_.labels && grid_.rows.empty() && !grid_.table.logarithmic)
    return march(grid_, extinctions_, from, step, to);
  for (int k = 0; k < count; ++k) to[k] = extinction(from + double(k) * step);
}

Matter Medium::matter(const glm::dvec3& at) const {
  Matter matter;
  matter.at = matter.start = at;
  const std::size_t index = entry(at);
  matter.extinction = extinctions_[index];
  if (!(matter.extinction > 0)) return matter;
  matter.albedo = glm::vec3(albedos_[index]);
  const Cell cell = cell_of(grid_, at);
  float v[64];
  load<4>(grid_, cell.first - 1, grid_.labels, v);
  const glm::vec3 gradient = trilinear(cell.within, [&](int x, int y, int z) {
    const float* c = v + (z + 1) * 16 + (y + 1) * 4 + x + 1;
    return 0.5f * glm::vec3(c[1] - c[-1], c[4] - c[-4], c[16] - c[-16]);
  });
  const auto& m = grid_.gradient_to_world;
  const glm::vec3 world(gradient.x * m[0] + gradient.y * m[1] + gradient.z * m[2]);
  const float length = glm::length(world);
  glm::dvec3 normal(0);  // times the share of the surface
  if (length > 1e-15f)
    normal = -std::expm1(-double{length} * grid_.inverse_gradient_floor) *
             glm::normalize(glm::dvec3(-world));
  for (int axis = 0; axis < 3; ++axis) {
    const double low = at[axis], high = grid_.dims[axis] - 1 - at[axis];
    const double cut = 1 - std::clamp(std::min(low, high), 0.0, 1.0);
    if (cut == 0) continue;
    const glm::dvec3 outwards = (low < high ? -1.0 : 1.0) * glm::dvec3(grid_.face_normals[axis]);
    normal = glm::mix(normal, outwards, cut);
  }
  for (const GridPlane& plane : grid_.clip)
    normal =
        glm::mix(normal, glm::dvec3(plane.outwards), 1 - std::clamp(plane.inside(at), 0.0, 1.0));
  const double size = glm::length(normal);
  if (!(size > 1e-15)) return matter;
  matter.normal = normal / size;
  matter.surface = static_cast<float>(albedos_[index].w * size);
  matter.albedo = glm::mix(matter.albedo, glm::vec3(grid_.table.colors[index]), matter.surface);
  // The layer that a gradient spreads a surface over does not shadow the surface.
  constexpr double kLayer = 1.5;  // voxels
  matter.start = at + per_world(kLayer * smallest_spacing_ * matter.surface * matter.normal);
  return matter;
}

bool Medium::clip(const glm::dvec3& from, const glm::dvec3& direction, double& begin,
                  double& end) const {
  for (int axis = 0; axis < 3; ++axis) {
    const double low = grid_.visible_low[axis] - from[axis];
    const double high = grid_.visible_high[axis] - from[axis];
    if (direction[axis] == 0) {
      if (low > 0 || high < 0) return false;
      continue;
    }
    const double a = low / direction[axis], b = high / direction[axis];
    begin = std::max(begin, std::min(a, b));
    end = std::min(end, std::max(a, b));
  }
  for (const GridPlane& plane : grid_.clip) plane.clip(from, direction, begin, end);
  return begin < end;
}

glm::dvec3 Medium::nearest_inside(const glm::dvec3& at) const {
  glm::dvec3 inside = at;
  for (const GridPlane& plane : grid_.clip)
    inside -= std::min(0.0, plane.inside(inside)) * plane.inwards;
  return glm::clamp(inside, grid_.visible_low, grid_.visible_high);
}

double Medium::below_box(const glm::dvec3& at) const {
  const glm::dvec3 below = glm::min(at - grid_.visible_low, grid_.visible_high - at);
  return std::min({below.x, below.y, below.z});
}

double Medium::below_clip(const glm::dvec3& at) const {
  double below = std::numeric_limits<double>::infinity();
  for (const GridPlane& plane : grid_.clip) below = std::min(below, plane.inside(at));
  return below;
}

HWY_INLINE Medium::Brick Medium::brick(const glm::dvec3& from, const glm::dvec3& direction,
                                       const glm::dvec3& inverse, double t) const {
  glm::ivec3 at;
  for (int axis = 0; axis < 3; ++axis)
    at[axis] = std::clamp(static_cast<int>(from[axis] + t * direction[axis]) >> grid_.brick_shift,
                          0, grid_.bricks[static_cast<std::size_t>(axis)] - 1);
  const std::size_t number = number_in(grid_.bricks, at);
  const int distance = grid_.distance[number];
  const int reach = std::max(distance, 1);
  double end = std::numeric_limits<double>::max();
  for (int axis = 0; axis < 3; ++axis) {
    // Of a direction that is 0, not reached: infinity, or not a number, which min() ignores.
    const int edge = inverse[axis] > 0 ? at[axis] + reach : at[axis] + 1 - reach;
    end = std::min(end, ((edge << grid_.brick_shift) - from[axis]) * inverse[axis]);
  }
  // Rounding may put the edge behind t: advance by a negligible distance.
  constexpr double kNudge = 1e-7;
  return {number, std::max(end, t) + kNudge * smallest_spacing_, distance > 0};
}

std::optional<double> Medium::fly(const glm::dvec3& from, const glm::dvec3& direction,
                                  double length, Random& random) const {
  double t = 0;
  if (!clip(from, direction, t, length)) return std::nullopt;
  double optical = -std::log1p(-random());  // depth to the next candidate
  const glm::dvec3 inverse = 1.0 / direction;
  while (t < length) {
    const Brick b = brick(from, direction, inverse, t);
    const double majorant = b.empty ? 0 : majorants_[b.number];
    const double end = std::min(b.end, length);
    if (majorant * (end - t) <= optical) {
      optical -= majorant * (end - t);
      t = b.end;
      continue;
    }
    t += optical / majorant;
    if (random() * majorant < extinction(from + t * direction)) return t;
    optical = -std::log1p(-random());
  }
  return std::nullopt;
}

double Medium::optical_depth(const glm::dvec3& from, const glm::dvec3& direction, double length,
                             double shift) const {
  double begin = 0;
  if (!clip(from, direction, begin, length)) return 0;
  const double step = kStep * smallest_spacing_;
  double depth = 0;
  const glm::dvec3 inverse = 1.0 / direction;
  double t = begin + shift * step;
  while (t < length && depth < kDark) {
    const Brick b = brick(from, direction, inverse, t);
    if (b.empty) {  // stay on the same positions
      t += step * std::max(1.0, std::ceil((b.end - t) / step));
      continue;
    }
    // Matter is denser than bricks: samples may lie in empty ones.
    March extinction;
    const int count = static_cast<int>(std::ceil(std::min((length - t) / step, 8.0)));
    extinctions(from + t * direction, step * direction, count, extinction);
    for (int k = 0; k < count; ++k) depth += step * extinction[k];
    t += count * step;
  }
  return depth;
}

}  // namespace slf
