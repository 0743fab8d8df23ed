#include "field/raycaster_kernel.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/raycaster_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

/// Four floats; the compiler's own vectors, which every target has.
using V4 = float __attribute__((vector_size(16)));

/// Four voxels in a row, as floats.
template <class T>
HWY_INLINE V4 load_row(const T* row) {
  typedef T T4 __attribute__((vector_size(4 * sizeof(T))));
  T4 voxels;
  std::memcpy(&voxels, row, sizeof voxels);
  return __builtin_convertvector(voxels, V4);
}

/// The 4×4×4 voxels around a cell, of which the value needs the inner rows and central differences
/// the outer ones. A view: of the volume itself or, at its border, of a clamped copy.
template <class T>
struct Neighbourhood {
  const T* first;
  std::ptrdiff_t stride_y, stride_z;

  HWY_INLINE V4 row(int y, int z) const { return load_row(first + z * stride_z + y * stride_y); }
  HWY_INLINE T at(int x, int y, int z) const { return first[z * stride_z + y * stride_y + x]; }
};

template <class T>
HWY_NOINLINE void copy_clamped(const RayGrid& grid, int x, int y, int z, T* to) {
  const auto* voxels = reinterpret_cast<const T*>(grid.voxels);
  const auto [nx, ny, nz] = grid.dims;
  for (int k = 0; k < 64; ++k) {
    const std::ptrdiff_t cx = std::clamp(x - 1 + (k & 3), 0, nx - 1);
    const std::ptrdiff_t cy = std::clamp(y - 1 + (k >> 2 & 3), 0, ny - 1);
    const std::ptrdiff_t cz = std::clamp(z - 1 + (k >> 4), 0, nz - 1);
    to[k] = voxels[(cz * ny + cy) * nx + cx];
  }
}

template <class T>
HWY_INLINE Neighbourhood<T> neighbourhood(const RayGrid& grid, int x, int y, int z, T* border) {
  const auto [nx, ny, nz] = grid.dims;
  if (HWY_UNLIKELY(x < 1 || y < 1 || z < 1 || x >= nx - 2 || y >= ny - 2 || z >= nz - 2)) {
    copy_clamped(grid, x, y, z, border);
    return {border, 4, 16};
  }
  const std::ptrdiff_t stride_z = std::ptrdiff_t{nx} * ny;
  return {reinterpret_cast<const T*>(grid.voxels) + (z - 1) * stride_z +
              (y - 1) * std::ptrdiff_t{nx} + (x - 1),
          nx, stride_z};
}

/// As Neighbourhood, but of label volumes: 1 where the voxel's label is visible, else 0.
template <class T>
class VisibleNeighbourhood {
 public:
  VisibleNeighbourhood(const RayGrid& grid, const Neighbourhood<T>& labels) {
    for (int z = 0; z < 4; ++z)
      for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 4; ++x) {
          const auto entry = static_cast<std::size_t>(labels.at(x, y, z));
          rows_[z][y][x] =
              entry < grid.table.entries.size() && grid.table.entries[entry].a > 0 ? 1.f : 0.f;
        }
  }
  HWY_INLINE V4 row(int y, int z) const { return load_row(rows_[z][y]); }

 private:
  float rows_[4][4][4];
};

/// Trilinear value of the four inner rows, as a row along x still to be interpolated.
template <class Rows>
HWY_INLINE V4 inner_row(const Rows& rows, float fy, float fz) {
  const V4 low = rows.row(1, 1) + fy * (rows.row(2, 1) - rows.row(1, 1));
  const V4 high = rows.row(1, 2) + fy * (rows.row(2, 2) - rows.row(1, 2));
  return low + fz * (high - low);
}

HWY_INLINE float along_x(V4 row, float fx) { return row[1] + fx * (row[2] - row[1]); }

/// Central differences one voxel apart, interpolated trilinearly: a normal without facets.
template <class Rows>
HWY_INLINE glm::vec3 gradient(const Rows& rows, V4 inner, float fx, float fy, float fz) {
  const auto across_y = [&](int z) {
    return (1 - fy) * (rows.row(2, z) - rows.row(0, z)) + fy * (rows.row(3, z) - rows.row(1, z));
  };
  const auto across_z = [&](int y) {
    return (1 - fz) * (rows.row(y, 2) - rows.row(y, 0)) + fz * (rows.row(y, 3) - rows.row(y, 1));
  };
  const V4 dy = (1 - fz) * across_y(1) + fz * across_y(2);
  const V4 dz = (1 - fy) * across_z(1) + fy * across_z(2);
  const float dx = (1 - fx) * (inner[2] - inner[0]) + fx * (inner[3] - inner[1]);
  return 0.5f * glm::vec3(dx, along_x(dy, fx), along_x(dz, fx));
}

HWY_INLINE std::int32_t table_index(const TransferTable& table, float value) {
  const auto last = static_cast<std::int32_t>(table.entries.size()) - 1;
  if (table.logarithmic) {
    const std::int64_t key = std::int64_t{ordered_bits(value)} - table.low_key;
    return static_cast<std::int32_t>(std::clamp<std::int64_t>(key >> table.shift, 0, last));
  }
  const float at = (value - table.low) * table.scale + 0.5f;
  return static_cast<std::int32_t>(std::min(std::max(at, 0.f), static_cast<float>(last)));
}

HWY_INLINE float shading(const RayGrid& grid, const glm::vec3& index_gradient) {
  const V4 normal = index_gradient.x * load_row(&grid.gradient_to_world[0].x) +
                    index_gradient.y * load_row(&grid.gradient_to_world[1].x) +
                    index_gradient.z * load_row(&grid.gradient_to_world[2].x);
  const V4 toward = normal * load_row(&grid.light.x);
  const V4 square = normal * normal;
  const float length2 = square[0] + square[1] + square[2] + 1e-30f;
  const float inverse = 1 / std::sqrt(length2);
  const float lambert = std::max(0.f, -(toward[0] + toward[1] + toward[2])) * inverse;
  const float sure = std::min(1.f, length2 * inverse * grid.inverse_gradient_floor);
  return 1 - (1 - grid.ambient) * (1 - lambert) * sure;
}

/// A segment in voxel indices: position(k) is where the k-th sample lies.
struct March {
  glm::vec3 start, delta;  // of one step
  float inverse[3];
  std::int64_t first, last;  // half-open range of samples inside the visible box
};

March make_march(const RayGrid& grid, const glm::dvec3& from, const glm::dvec3& to) {
  const glm::dvec3 a = grid.world_to_index * (from - grid.origin);
  const glm::dvec3 b = grid.world_to_index * (to - grid.origin);
  const double length = glm::distance(from, to);
  March march{};
  if (!(length > 0)) return march;
  const glm::dvec3 delta = (b - a) * (grid.step / length);
  double low = 0, high = length / grid.step;  // in steps
  for (int axis = 0; axis < 3; ++axis) {
    const double from_low = grid.visible_low[axis] - a[axis];
    const double from_high = grid.visible_high[axis] - a[axis];
    if (std::abs(delta[axis]) < 1e-12) {
      if (from_low > 0 || from_high < 0) return march;
      continue;
    }
    const double t0 = from_low / delta[axis], t1 = from_high / delta[axis];
    const double enter = std::min(t0, t1), leave = std::max(t0, t1);
    low = std::max(low, enter);
    high = std::min(high, leave);
  }
  if (!(low < high)) return march;
  march.first = static_cast<std::int64_t>(std::ceil(low - 0.5));  // sample k is at k + 0.5 steps
  march.last = static_cast<std::int64_t>(std::floor(high - 0.5)) + 1;
  march.start = glm::vec3(a + delta * (static_cast<double>(march.first) + 0.5));
  march.delta = glm::vec3(delta);
  for (int axis = 0; axis < 3; ++axis)
    march.inverse[axis] = std::abs(march.delta[axis]) < 1e-12f ? std::numeric_limits<float>::max()
                                                               : 1 / march.delta[axis];
  return march;
}

/// How many steps stay inside the empty cube of bricks around a position: at least 1.
HWY_INLINE int leap(const March& march, const glm::vec3& p, const int brick[3], int distance) {
  float steps = 1e9f;
  for (int axis = 0; axis < 3; ++axis) {
    const bool up = march.delta[axis] > 0;
    const int edge = up ? brick[axis] + distance : brick[axis] - distance + 1;
    const float away = (static_cast<float>(edge << kBrickShift) - p[axis]) * march.inverse[axis];
    if (march.inverse[axis] != std::numeric_limits<float>::max()) steps = std::min(steps, away);
  }
  return std::max(1, static_cast<int>(steps));
}

constexpr float kOpaque = 1 - 1.f / 256;

template <class T, bool kLabels>
RaySample trace_typed(const RayGrid& grid, const glm::dvec3& from, const glm::dvec3& to) {
  const March march = make_march(grid, from, to);
  const std::int64_t count = march.last - march.first;
  V4 color = V4{};
  float alpha = 0, depth = 0;
  T border[64];
  for (std::int64_t k = 0; k < count;) {
    const glm::vec3 p = march.start + static_cast<float>(k) * march.delta;
    // Rounding may leave the box by a hair; clamping keeps every access inside the volume.
    const int x = std::clamp(static_cast<int>(p.x), 0, grid.dims[0] - 2);
    const int y = std::clamp(static_cast<int>(p.y), 0, grid.dims[1] - 2);
    const int z = std::clamp(static_cast<int>(p.z), 0, grid.dims[2] - 2);
    const int brick[3] = {x >> kBrickShift, y >> kBrickShift, z >> kBrickShift};
    const int distance =
        grid.distance[(static_cast<std::size_t>(brick[2]) * grid.bricks[1] + brick[1]) *
                          grid.bricks[0] +
                      brick[0]];
    if (distance > 0 && grid.leap) {
      k += leap(march, p, brick, distance);
      continue;
    }
    ++k;

    const float fx = p.x - static_cast<float>(x);
    const float fy = p.y - static_cast<float>(y);
    const float fz = p.z - static_cast<float>(z);
    const Neighbourhood<T> rows = neighbourhood(grid, x, y, z, border);
    V4 inner = V4{};
    std::int32_t index;
    if constexpr (kLabels) {
      index =
          static_cast<std::int32_t>(rows.at(1 + (fx >= 0.5f), 1 + (fy >= 0.5f), 1 + (fz >= 0.5f)));
      if (static_cast<std::size_t>(index) >= grid.table.entries.size()) continue;
    } else {
      inner = inner_row(rows, fy, fz);
      index = table_index(grid.table, along_x(inner, fx));
    }
    const glm::vec4& entry = grid.table.entries[static_cast<std::size_t>(index)];
    if (entry.a <= 0) continue;

    float light = 1;
    if (grid.shade) {
      if constexpr (kLabels) {
        const VisibleNeighbourhood<T> visible(grid, rows);
        light = shading(grid, gradient(visible, inner_row(visible, fy, fz), fx, fy, fz));
      } else {
        light = shading(grid, gradient(rows, inner, fx, fy, fz));
      }
    }
    const float weight = (1 - alpha) * entry.a;
    color += (weight * light) * load_row(&entry.x);
    depth += weight * static_cast<float>(k - 1);
    alpha += weight;
    if (alpha > kOpaque) break;
  }
  RaySample sample;
  if (alpha <= 0) return sample;
  // What early termination left out is within a step of 8 bits: count it as opaque.
  const float whole = alpha > kOpaque ? 1 / alpha : 1;
  sample.rgba = glm::vec4(color[0], color[1], color[2], alpha) * whole;
  const double steps = static_cast<double>(march.first) + 0.5 + depth / alpha;
  sample.depth =
      static_cast<float>(std::clamp(steps * grid.step / glm::distance(from, to), 0.0, 1.0));
  return sample;
}

RaySample trace_any(const RayGrid& grid, const glm::dvec3& from, const glm::dvec3& to) {
  switch (grid.type) {
    case ScalarType::u8:
      return grid.labels ? trace_typed<std::uint8_t, true>(grid, from, to)
                         : trace_typed<std::uint8_t, false>(grid, from, to);
    case ScalarType::u16:
      return grid.labels ? trace_typed<std::uint16_t, true>(grid, from, to)
                         : trace_typed<std::uint16_t, false>(grid, from, to);
    case ScalarType::i8:
      return trace_typed<std::int8_t, false>(grid, from, to);
    case ScalarType::i16:
      return trace_typed<std::int16_t, false>(grid, from, to);
    default:
      return trace_typed<float, false>(grid, from, to);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(trace_any);

std::int32_t ordered_bits(float value) {
  const auto bits = std::bit_cast<std::int32_t>(value);
  return bits >= 0 ? bits : std::numeric_limits<std::int32_t>::min() - bits;
}

RaySample trace_ray(const RayGrid& grid, const glm::dvec3& from, const glm::dvec3& to) {
  return HWY_DYNAMIC_DISPATCH(trace_any)(grid, from, to);
}

}  // namespace slf
#endif  // HWY_ONCE
