#include "field/scene/light_reach.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "base/parallel.h"
#include "base/try.h"
#include "field/scene/light_depth.h"

namespace slf {
namespace {

/// What is marched from a place on, in nodes: close to a surface, where the light begins to be
/// scattered, the grid's interpolation would darken it by its own matter.
constexpr double kNearNodes = 2;
/// Rows of rays that one thread sweeps at a time.
constexpr int kBandRows = 16;
/// Nodes within matter are dark, but not so the places beside it, such as those in a narrow gap. So
/// a node counts by how open it is: by the light that passes this many nodes of its own matter.
constexpr float kOpenNodes = 4;
constexpr float kOpen = 255;                  // stored for a node without matter
constexpr float kWholeLight = 65535 / kOpen;  // stored for all light, times the node's openness

/// exp(-depth) within 1 % up to a depth of 5; a form that compilers vectorise.
float transmittance(float depth) {
  const float x = std::min(depth, 16.f) / 8;
  float t = 1 / (1 + x * (1 + x * (0.5f + x / 6)));
  t *= t;
  t *= t;
  return t * t;
}

/// Values on a grid whose axes are renamed: u is contiguous in memory, and a sweep advances
/// along w.
template <class T>
struct Axes {
  std::array<int, 3> dims;                // along u, v, w
  std::array<std::ptrdiff_t, 3> strides;  // the first is 1
  T* values;

  [[nodiscard]] T* row(int v, int w) const { return values + v * strides[1] + w * strides[2]; }
};

/// One direction of parallel light. Rays start at the nodes of the first slice and outside of it,
/// and advance to the next slice by (shift[0], shift[1]) nodes.
struct Sweep {
  std::array<double, 2> shift;
  float length;    // of a ray between two slices, world units
  bool ascending;  // whether light enters at w = 0
  float share;     // of the light that comes from this direction
};

/// The part of a sweep that rows `first` to `end` - 1 of the rays take, for a thread's own nodes:
/// those between these rows and their successors. Adds the transmittance at each node to `sum`.
void sweep_band(const Axes<const float>& extinction, const Axes<float>& sum, const Sweep& sweep,
                int first, int end) {
  const auto [nu, nv, nw] = extinction.dims;
  const int reach = static_cast<int>(std::ceil((nw - 1) * std::abs(sweep.shift[0]))) + 2;
  const int rays = nu + 2 * reach;  // ray `reach` starts at u = 0
  const auto rows = static_cast<std::size_t>(end - first + 1);
  const auto width = static_cast<std::size_t>(rays);
  std::vector<float> depth(rows * width, 0), arrived(rows * width, 1);
  std::vector<float> mean(static_cast<std::size_t>(nu) + 1, 0);  // between two rows of nodes
  for (int slice = 0; slice < nw; ++slice) {
    const int w = sweep.ascending ? slice : nw - 1 - slice;
    const double offset_u = slice * sweep.shift[0], offset_v = slice * sweep.shift[1];
    const int whole_u = static_cast<int>(std::floor(offset_u));
    const int whole_v = static_cast<int>(std::floor(offset_v));
    const auto part_u = static_cast<float>(offset_u - whole_u);
    const auto part_v = static_cast<float>(offset_v - whole_v);
    for (int row = first; row <= end; ++row) {
      float* to = depth.data() + static_cast<std::size_t>(row - first) * width;
      float* t = arrived.data() + static_cast<std::size_t>(row - first) * width;
      const int v = row + whole_v;
      if (v < -1 || v >= nv) continue;
      // The ray that is within the first cell along u, beyond the grid's border.
      const int begin = reach - 1 - whole_u;
      // There is no matter beyond the borders.
      const bool inside_v = v >= 0 && (part_v > 0 ? v + 1 : v) < nv;
      const int last = part_u > 0 ? nu - 1 : nu;
      const float* low = inside_v ? extinction.row(v, w) : nullptr;
      const float* high = inside_v && part_v > 0 ? extinction.row(v + 1, w) : low;
      for (int u = 0; inside_v && u < nu; ++u) mean[u] = (1 - part_v) * low[u] + part_v * high[u];
      for (int u = 0; u <= nu; ++u) {
        const bool inside = inside_v && u > 0 && u <= last;
        const float step =
            inside ? sweep.length * ((1 - part_u) * mean[u - 1] + part_u * mean[u]) : 0;
        // Half of a step is before the slice, except for the first, which is on the border.
        t[begin + u] = transmittance(to[begin + u] + (slice > 0 ? 0.5f * step : 0));
        to[begin + u] += (slice > 0 ? 1 : 0.5f) * step;
      }
    }
    for (int row = first; row < end; ++row) {
      const int v = row + whole_v + 1;  // between this row and the next
      if (v < 0 || v >= nv) continue;
      const float* low =
          arrived.data() + static_cast<std::size_t>(row - first) * width + reach - 1 - whole_u;
      const float* high = low + width;
      float* to = sum.row(v, w);
      for (int u = 0; u < nu; ++u) {
        const float a = part_u * low[u] + (1 - part_u) * low[u + 1];
        const float b = part_u * high[u] + (1 - part_u) * high[u + 1];
        to[u] += sweep.share * (part_v * a + (1 - part_v) * b);
      }
    }
  }
}

/// Sweeps a direction, in voxel indices per world unit, that dominates along w.
Result<void> sweep_direction(const Axes<const float>& extinction, const Axes<float>& sum,
                             const std::array<double, 3>& toward, double spacing, float share,
                             unsigned threads) {
  Sweep sweep{};
  for (std::size_t axis = 0; axis < 2; ++axis)
    sweep.shift[axis] = -toward[axis] / std::abs(toward[2]);
  sweep.length = static_cast<float>(spacing / std::abs(toward[2]));
  sweep.ascending = toward[2] < 0;
  sweep.share = share;
  const double farthest = (extinction.dims[2] - 1) * sweep.shift[1];
  const int begin = -1 - static_cast<int>(std::ceil(std::max(farthest, 0.0)));
  const int end = extinction.dims[1] + static_cast<int>(std::ceil(std::max(-farthest, 0.0)));
  const auto bands = static_cast<std::uint64_t>((end - begin + kBandRows - 1) / kBandRows);
  return parallel_for(bands, threads, [&](std::uint64_t band) {
    const int first = begin + static_cast<int>(band) * kBandRows;
    sweep_band(extinction, sum, sweep, first, std::min(first + kBandRows, end));
  });
}

/// Calls f(number, turned) for each node: its number, and that in a grid in which y is contiguous,
/// then z, then x.
template <class F>
void for_each_turned(const LightGrid& light, const F& f) {
  const auto nx = static_cast<std::size_t>(light.dims[0]),
             ny = static_cast<std::size_t>(light.dims[1]),
             nz = static_cast<std::size_t>(light.dims[2]);
  for (std::size_t z = 0, number = 0; z < nz; ++z)
    for (std::size_t y = 0; y < ny; ++y)
      for (std::size_t x = 0; x < nx; ++x, ++number) f(number, (x * nz + z) * ny + y);
}

/// Sweeps all directions of one light.
class LightSweeper {
 public:
  LightSweeper(const Medium& medium, const LightGrid& light, const std::vector<float>& extinction,
               unsigned threads)
      : medium_(medium), light_(light), extinction_(extinction), threads_(threads) {}

  /// The transmittance at each node times how open it is, as LightReach stores it.
  [[nodiscard]] Result<std::vector<std::uint16_t>> sweep(const PlacedLight& placed,
                                                         const std::vector<std::uint8_t>& open) {
    sum_.assign(light_.size(), 0);
    turned_sum_.clear();
    const std::vector<glm::dvec3> directions = placed.directions();
    for (const glm::dvec3& direction : directions)
      SLF_TRY(add(medium_.per_world(direction), 1 / static_cast<float>(directions.size())));
    if (!turned_sum_.empty())
      for_each_turned(light_, [&](std::size_t number, std::size_t turned) {
        sum_[number] += turned_sum_[turned];
      });
    std::vector<std::uint16_t> swept(light_.size());
    for (std::size_t k = 0; k < swept.size(); ++k)
      swept[k] = static_cast<std::uint16_t>(std::min(sum_[k], 1.f) * kWholeLight * open[k] + 0.5f);
    return swept;
  }

 private:
  /// The direction is in voxel indices per world unit.
  Result<void> add(const glm::dvec3& toward, float share) {
    const auto [nx, ny, nz] = light_.dims;
    const std::ptrdiff_t row = nx, slice = row * ny;
    const glm::dvec3 size = glm::abs(toward);
    if (size.x > size.y && size.x > size.z) {
      turn();
      const std::array dims{ny, nz, nx};
      const std::array<std::ptrdiff_t, 3> strides{1, ny, std::ptrdiff_t{ny} * nz};
      return sweep_direction({dims, strides, turned_extinction_.data()},
                             {dims, strides, turned_sum_.data()}, {toward.y, toward.z, toward.x},
                             light_.spacing, share, threads_);
    }
    const bool along_z = size.z >= size.y;
    const std::array dims{nx, along_z ? ny : nz, along_z ? nz : ny};
    const std::array<std::ptrdiff_t, 3> strides{1, along_z ? row : slice, along_z ? slice : row};
    return sweep_direction({dims, strides, extinction_.data()}, {dims, strides, sum_.data()},
                           {toward.x, along_z ? toward.y : toward.z, along_z ? toward.z : toward.y},
                           light_.spacing, share, threads_);
  }

  void turn() {
    if (turned_extinction_.empty()) {
      turned_extinction_.resize(light_.size());
      for_each_turned(light_, [&](std::size_t number, std::size_t turned) {
        turned_extinction_[turned] = extinction_[number];
      });
    }
    if (turned_sum_.empty()) turned_sum_.assign(light_.size(), 0);
  }

  const Medium& medium_;
  const LightGrid& light_;
  const std::vector<float>& extinction_;
  unsigned threads_;
  std::vector<float> sum_, turned_extinction_, turned_sum_;
};

}  // namespace

Result<std::vector<float>> node_extinctions(const Medium& medium, const LightGrid& light,
                                            unsigned threads) {
  const RayGrid& grid = medium.grid();
  std::vector<float> extinction(light.size(), 0);
  const int side = std::clamp(static_cast<int>(std::ceil(light.spacing)), 2, 4);
  const double width = 1.0 / side;
  const auto rows = static_cast<std::uint64_t>(light.dims[1]) * light.dims[2];
  const auto nx = static_cast<std::size_t>(light.dims[0]);
  SLF_TRY(parallel_for(rows, threads, [&](std::uint64_t row) {
    for (std::size_t x = 0; x < nx; ++x) {
      const std::size_t number = row * nx + x;
      const glm::ivec3 node = node_at(light, number);
      if (!near_matter(grid, light, node)) continue;
      float sum = 0;
      for (int k = 0; k < side * side * side; ++k) {
        const glm::dvec3 cell(k % side, k / side % side, k / (side * side));
        const glm::dvec3 at = glm::dvec3(node) + (cell + 0.5) * width - 0.5;
        sum += medium.extinction(
            glm::clamp(light.low + light.spacing * at, grid.visible_low, grid.visible_high));
      }
      extinction[number] = sum / static_cast<float>(side * side * side);
    }
  }));
  return extinction;
}

LightReach::LightReach(const Medium& medium, const LightGrid& light)
    : medium_(medium),
      light_(light),
      near_(kNearNodes * light.spacing * medium.smallest_spacing()) {}

Result<LightReach> LightReach::make(const Medium& medium, const Illumination& illumination,
                                    const LightGrid& light, const std::vector<float>& extinction,
                                    unsigned threads) {
  LightReach reach(medium, light);
  const double cell = light.spacing * medium.smallest_spacing();
  reach.open_.reserve(extinction.size());
  for (const float e : extinction)
    reach.open_.push_back(static_cast<std::uint8_t>(
        1 + (kOpen - 1) * transmittance(kOpenNodes * static_cast<float>(cell) * e)));
  LightSweeper sweeper(medium, light, extinction, threads);
  for (const PlacedLight& placed : illumination.lights) {
    reach.swept_.emplace_back();
    if (!placed.distant()) continue;
    auto swept = SLF_TRY(sweeper.sweep(placed, reach.open_));
    reach.swept_.back() = std::move(swept);
  }
  return reach;
}

float LightReach::operator()(std::size_t light, const IncidentLight& arrival,
                             const glm::dvec3& from, double shift) const {
  const std::vector<std::uint16_t>& swept = swept_[light];
  const glm::dvec3 toward = medium_.per_world(arrival.direction);
  const double length = swept.empty() ? arrival.distance : near_;
  const double depth = medium_.optical_depth(from, toward, length, shift);
  if (depth >= Medium::kDark) return 0;
  const auto near = static_cast<float>(std::exp(-depth));
  const glm::dvec3 at = (from + length * toward - light_.low) / light_.spacing;
  const glm::dvec3 last(light_.dims[0] - 1, light_.dims[1] - 1, light_.dims[2] - 1);
  const bool outside =
      glm::any(glm::lessThan(at, glm::dvec3(0))) || glm::any(glm::greaterThan(at, last));
  if (swept.empty() || outside) return near;
  const float open = interpolate(light_, open_, at);
  return open > 0 ? near * interpolate(light_, swept, at) / (open * kWholeLight) : 0.f;
}

}  // namespace slf
