#include "source/raycast/raycaster_kernel.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "source/raycast/raycaster_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "source/raycast/raycaster_light-inl.h"
#include "source/raycast/raycaster_rows-inl.h"
#include "source/raycast/raycaster_samples-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

// kBatch rays advance together, by one interval per pass. An interval lies in one cell of the
// volume, along which the value is a cubic polynomial: so no sample falls between two others, and
// neighbouring rays differ by no more than their positions do. A pass alternates between two kinds
// of short loops over the batch: vector arithmetic, and look-ups lane by lane. So neither waits for
// the other, and their data stay in the first-level cache. Lanes do not mix: a ray's sample does
// not depend on the other rays.
constexpr std::size_t kBatch = kMaxSamples;
static_assert(kBatch % kLanes == 0);

/// The rays that are being traced. Ray i of the batch is element i of each array. Positions are in
/// cells, lengths in units of the grid.
struct RayBatch {
  std::size_t size = 0;
  // The ray: t from its start is at start + t·delta, up to t = end.
  alignas(64) float start[3][kBatch];
  alignas(64) float delta[3][kBatch];
  alignas(64) float inverse[3][kBatch];  // 0: parallel to the faces of this axis
  alignas(64) float end[kBatch];
  double first[kBatch];   // distance of the start from the ray's beginning
  double length[kBatch];  // of the whole ray
  std::size_t ray[kBatch];
  // The result so far, except its colour.
  alignas(64) float alpha[kBatch];
  alignas(64) float depth[kBatch];
  // Of projections: the value so far, as a position in a row of the table, the row, and the length
  // over which values were seen.
  float value[kBatch];
  std::int32_t row[kBatch];
  float seen[kBatch];
  // Its next interval: the cell, or the cube of empty bricks around it, and where it begins and
  // ends.
  alignas(64) std::int32_t cell[3][kBatch];
  alignas(64) std::int32_t brick[kBatch];
  alignas(64) std::int32_t bit[kBatch];    // of the cell in RayGrid::visible_octants
  alignas(64) std::int32_t shown[kBatch];  // that bit: 1 if the cell can be visible
  alignas(64) std::int32_t distance[kBatch];
  alignas(64) float from[kBatch];
  alignas(64) float to[kBatch];
  alignas(64) float within[3][kBatch];  // the beginning in its cell, in voxels
  alignas(64) float across[3][kBatch];  // from there to the end
  alignas(64) float span[kBatch];       // its length
};

/// Puts a ray into place i of the batch. False: it misses the visible box.
bool start_ray(const RayGrid& grid, const Segment& segment, RayBatch& batch, std::size_t i) {
  const double length = glm::distance(segment.from, segment.to) / grid.unit;
  if (!(length > 0)) return false;
  const glm::dvec3 a = grid.world_to_index * (segment.from - grid.origin);
  const glm::dvec3 delta = grid.world_to_index * (segment.to - segment.from) / length;
  const double cells_per_voxel = 1 << grid.cell_shift;
  double low = 0, high = length;
  for (int axis = 0; axis < 3; ++axis) {
    const double from_low = grid.visible_low[axis] - a[axis];
    const double from_high = grid.visible_high[axis] - a[axis];
    if (std::abs(delta[axis]) < 1e-12) {
      if (from_low > 0 || from_high < 0) return false;
      batch.inverse[axis][i] = 0;
      continue;
    }
    const double inverse = 1 / delta[axis];
    const double t0 = from_low * inverse, t1 = from_high * inverse;
    low = std::max(low, std::min(t0, t1));
    high = std::min(high, std::max(t0, t1));
    batch.inverse[axis][i] = static_cast<float>(inverse / cells_per_voxel);
  }
  for (const GridPlane& plane : grid.clip) plane.clip(a, delta, low, high);
  if (!(low < high)) return false;
  for (int axis = 0; axis < 3; ++axis) {
    const double start = cells_per_voxel * (a[axis] + low * delta[axis]);
    batch.start[axis][i] = static_cast<float>(start);
    batch.delta[axis][i] = static_cast<float>(cells_per_voxel * delta[axis]);
    batch.cell[axis][i] = std::clamp(static_cast<int>(start), 0, grid.cells[axis] - 1);
  }
  batch.end[i] = static_cast<float>(high - low);
  batch.from[i] = 0;
  batch.first[i] = low;
  batch.length[i] = length;
  batch.alpha[i] = batch.depth[i] = 0;
  batch.value[i] = batch.seen[i] = 0;
  return true;
}

void move_ray(RayBatch& batch, std::size_t from, std::size_t to) {
  const auto move = [&](auto&... arrays) { ((arrays[to] = arrays[from]), ...); };
  for (int axis = 0; axis < 3; ++axis)
    move(batch.start[axis], batch.delta[axis], batch.inverse[axis], batch.cell[axis]);
  move(batch.from, batch.end, batch.first, batch.length, batch.ray, batch.alpha, batch.depth,
       batch.value, batch.row, batch.seen);
}

/// Finds each ray's brick, and its cell there.
HWY_INLINE void find_bricks(const RayGrid& grid, RayBatch& batch) {
  for (std::size_t i = 0; i < batch.size; i += kLanes) {
    Ints brick = ints(0), bit = ints(0);
    for (int axis = 2; axis >= 0; --axis) {
      const Ints cell = hn::ShiftRightSame(load(batch.cell[axis] + i), grid.cell_shift);
      brick = brick * ints(grid.bricks[axis]) + hn::ShiftRightSame(cell, grid.brick_shift);
      const Ints half = hn::ShiftRightSame(cell, grid.brick_shift - 1);
      bit = hn::ShiftLeft<1>(bit) + hn::And(half, ints(1));
    }
    store(brick, batch.brick + i);
    store(bit, batch.bit + i);
  }
}

/// The cells from `low` to `high`, exclusive, along an axis: one or, in empty space, those of the
/// cube of empty bricks.
struct CellRange {
  Ints low, high;
};
HWY_INLINE CellRange cell_range(const RayGrid& grid, const RayBatch& batch, int axis,
                                std::size_t i) {
  const Ints one = ints(1);
  const Ints cell = load(batch.cell[axis] + i);
  const Ints distance = load(batch.distance + i);
  const int shift = grid.brick_shift + grid.cell_shift;
  const Ints brick = hn::ShiftRightSame(cell, shift);
  const auto empty = distance > ints(0);
  return {hn::IfThenElse(empty, hn::ShiftLeftSame(brick - distance + one, shift), cell),
          hn::IfThenElse(empty, hn::ShiftLeftSame(brick + distance, shift), cell + one)};
}

/// Where each ray leaves its range of cells through a face of this axis.
HWY_INLINE Floats leaves(const RayBatch& batch, const CellRange& range, int axis, std::size_t i) {
  const Floats inverse = load(batch.inverse[axis] + i);
  const auto up = hn::RebindMask(kInts, inverse > floats(0));
  const Floats face = hn::ConvertTo(kFloats, hn::IfThenElse(up, range.high, range.low));
  const Floats t = (face - load(batch.start[axis] + i)) * inverse;
  return hn::IfThenElse(inverse == floats(0), floats(1e30f), t);
}

/// Finds each ray's interval. It ends where the ray leaves its cells, or before, so that
/// intervals in one cell have equal lengths of at most one step.
HWY_INLINE void find_intervals(const RayGrid& grid, RayBatch& batch) {
  const Floats scale = floats(grid.cell_shift ? 0.5f : 1.f);
  const Floats inverse_step = floats(1 / grid.step);
  for (std::size_t i = 0; i < batch.size; i += kLanes) {
    Floats to = load(batch.end + i);
    for (int axis = 0; axis < 3; ++axis)
      to = hn::Min(to, leaves(batch, cell_range(grid, batch, axis, i), axis, i));
    const Floats from = load(batch.from + i);
    const Floats length = hn::Max(to - from, floats(0));
    const Floats steps = hn::Ceil(length * inverse_step - floats(1e-3f));
    const auto divided =
        hn::And(steps > floats(1.f), hn::RebindMask(kFloats, load(batch.distance + i) == ints(0)));
    to = hn::IfThenElse(divided, from + length / steps, hn::Max(from, to));
    store(to, batch.to + i);
    store(to - from, batch.span + i);
    for (int axis = 0; axis < 3; ++axis) {
      const Floats delta = load(batch.delta[axis] + i);
      const Ints cell = hn::ShiftRightSame(load(batch.cell[axis] + i), grid.cell_shift);
      const Floats at = hn::MulAdd(from, delta, load(batch.start[axis] + i));
      store(hn::MulSub(at, scale, hn::ConvertTo(kFloats, cell)), batch.within[axis] + i);
      store((to - from) * delta * scale, batch.across[axis] + i);
    }
  }
}

/// Moves each ray to the end of its interval, and from there into the next cell if it ends there.
HWY_INLINE void advance(const RayGrid& grid, RayBatch& batch) {
  for (std::size_t i = 0; i < batch.size; i += kLanes) {
    const Floats to = load(batch.to + i);
    Floats from = to;
    for (int axis = 0; axis < 3; ++axis) {
      const CellRange range = cell_range(grid, batch, axis, i);
      const auto ends = hn::RebindMask(kInts, leaves(batch, range, axis, i) <= to);
      const auto up = hn::RebindMask(kInts, load(batch.inverse[axis] + i) > floats(0));
      const Ints one = ints(1);
      const Ints at = hn::ConvertTo(
          kInts, hn::MulAdd(to, load(batch.delta[axis] + i), load(batch.start[axis] + i)));
      const Ints inside = hn::Min(hn::Max(at, range.low), range.high - one);
      const Ints cell =
          hn::IfThenElse(ends, hn::IfThenElse(up, range.high, range.low - one), inside);
      // Rounding may move a ray out of the volume just before its end.
      const Ints last = ints(grid.cells[axis] - 1);
      const auto outside = hn::Or(cell<ints(0), cell> last);
      from = hn::IfThenElse(hn::RebindMask(kFloats, outside), load(batch.end + i), from);
      store(hn::Min(hn::Max(cell, ints(0)), last), batch.cell[axis] + i);
    }
    store(from, batch.from + i);
  }
}

constexpr float kOpaque = 1 - 1.f / 256;

/// Adds the values of sample s that can be visible to the projection of its ray.
template <class S>
void project(const RayGrid& grid, const Samples<S>& samples, std::size_t s, RayBatch& batch) {
  const auto i = static_cast<std::size_t>(samples.ray[s]);
  for (int k = 0; k <= kPieces; ++k) {
    const float value = samples.value[k][s];
    const auto entry = static_cast<std::size_t>(samples.row[s] + std::lround(value));
    if (!(grid.table.extinctions[entry] > 0)) continue;
    const float t = batch.from[i] + samples.length[s] * static_cast<float>(k) / kPieces;
    if (grid.projection == Projection::mean) {
      // The trapezoidal rule.
      const float length =
          samples.length[s] * (k == 0 || k == kPieces ? 0.5f / kPieces : 1.f / kPieces);
      batch.value[i] += length * value;
      batch.depth[i] += length * t;
      batch.seen[i] += length;
      batch.row[i] = samples.row[s];
    } else if (batch.seen[i] == 0 ||
               (grid.projection == Projection::minimum ? value < batch.value[i]
                                                       : value > batch.value[i])) {
      batch.value[i] = value;
      batch.depth[i] = t;
      batch.seen[i] = 1;
      batch.row[i] = samples.row[s];
    }
  }
}

/// Ends the projection of ray i: it shows the colour of the value.
void finish_projection(const RayGrid& grid, RayBatch& batch, std::size_t i, RaySample& sample) {
  if (!(batch.seen[i] > 0)) return;
  const auto entry =
      static_cast<std::size_t>(batch.row[i] + std::lround(batch.value[i] / batch.seen[i]));
  const auto opacity = static_cast<float>(opacity_of(grid.table, grid.table.extinctions[entry]));
  for (int c = 0; c < 3; ++c) sample.rgba[c] = opacity * grid.table.colors[entry][c];
  batch.depth[i] *= opacity / batch.seen[i];
  batch.alpha[i] = opacity;
}

/// Removes the rays that have ended, and replaces them by new rays or by the batch's last ones.
void replace_finished(const RayGrid& grid, std::span<const Segment> rays, std::size_t& next,
                      RayBatch& batch, std::span<RaySample> out) {
  // Backwards, so that a ray that moves down was checked before.
  for (std::size_t group = (batch.size + kLanes - 1) / kLanes; group-- > 0;) {
    const std::size_t begin = group * kLanes;
    const auto going = load(batch.end + begin) > load(batch.from + begin);
    const auto opaque = load(batch.alpha + begin) > floats(kOpaque);
    const auto ended =
        hn::And(hn::Not(hn::AndNot(opaque, going)), hn::FirstN(kFloats, batch.size - begin));
    std::uint8_t bytes[8] = {};
    hn::StoreMaskBits(kFloats, ended, bytes);
    for (unsigned bits = bytes[0] | bytes[1] << 8; bits != 0;) {
      const int lane = std::bit_width(bits) - 1;
      bits ^= 1u << lane;
      const std::size_t i = begin + static_cast<std::size_t>(lane);
      RaySample& sample = out[batch.ray[i]];
      if (grid.projection != Projection::none) finish_projection(grid, batch, i, sample);
      sample.rgba.a = batch.alpha[i];
      if (sample.rgba.a > 0)
        sample.depth = static_cast<float>(std::clamp(
            (batch.first[i] + batch.depth[i] / batch.alpha[i]) / batch.length[i], 0.0, 1.0));
      while (next < rays.size() && !start_ray(grid, rays[next], batch, i)) ++next;
      if (next < rays.size())
        batch.ray[i] = next++;
      else
        move_ray(batch, --batch.size, i);
    }
  }
}

/// Copies the intervals in cells that can be visible to the samples.
template <class S>
HWY_INLINE void take(const RayBatch& batch, Samples<S>& samples) {
  const auto copy_all = [&](const auto& copy) {
    for (int axis = 0; axis < 3; ++axis) {
      copy(batch.cell[axis], samples.cell[axis]);
      copy(batch.within[axis], samples.start[axis]);
      copy(batch.across[axis], samples.across[axis]);
    }
    copy(batch.span, samples.length);
  };
  samples.size = 0;
#if HWY_TARGET <= HWY_AVX3  // compresses fast
  for (std::size_t i = 0; i < batch.size; i += kLanes) {
    const auto shown = hn::And(load(batch.shown + i) != ints(0), hn::FirstN(kInts, batch.size - i));
    copy_all([&](const auto* from, auto* to) {
      constexpr hn::ScalableTag<std::remove_cvref_t<decltype(*from)>> d;
      hn::StoreU(hn::Compress(hn::Load(d, from + i), hn::RebindMask(d, shown)), d,
                 to + samples.size);
    });
    hn::StoreU(hn::Compress(hn::Iota(kInts, static_cast<std::int32_t>(i)), shown), kInts,
               samples.ray + samples.size);
    samples.size += hn::CountTrue(kInts, shown);
  }
#else
  for (std::size_t i = 0; i < batch.size; ++i) {
    samples.ray[samples.size] = static_cast<std::int32_t>(i);
    samples.size += static_cast<std::size_t>(batch.shown[i]);
  }
  copy_all([&](const auto* from, auto* to) {
    for (std::size_t s = 0; s < samples.size; ++s) to[s] = from[samples.ray[s]];
  });
#endif
}

/// If cells are split: finds each sample's row of the table, that of the nearest voxel, and its
/// whole cell.
template <class T, class S>
void find_rows(const RayGrid& grid, Samples<S>& samples) {
  for (std::size_t s = 0; s < samples.size; ++s) {
    std::size_t nearest = 0;
    for (int axis = 2; axis >= 0; --axis) {
      std::int32_t& cell = samples.cell[axis][s];
      nearest = nearest * static_cast<std::size_t>(grid.dims[axis]) +
                static_cast<std::size_t>((cell + 1) >> 1);
      cell >>= 1;
    }
    samples.row[s] =
        grid.labels ? static_cast<std::int32_t>(reinterpret_cast<const T*>(grid.voxels)[nearest])
                    : grid.rows[nearest] * static_cast<std::int32_t>(grid.table.entries);
  }
}

/// Loads the voxels around each sample: the inner rows or all.
template <class T, bool kLabels, int kRows, class S>
HWY_INLINE void load_rows(const RayGrid& grid, Samples<S>& samples) {
  const std::ptrdiff_t stride_y = grid.dims[0], stride_z = stride_y * grid.dims[1];
  std::uint32_t inner[3];  // cells along each axis that have neighbours on both sides
  for (int axis = 0; axis < 3; ++axis)
    inner[axis] = static_cast<std::uint32_t>(std::max(grid.dims[axis] - 3, 0));
  std::ptrdiff_t offset[kRows], border_offset[kRows];
  for (int r = 0; r < kRows; ++r) {
    offset[r] = (kRowZ[r] - 1) * stride_z + (kRowY[r] - 1) * stride_y - 1;
    border_offset[r] = kRowZ[r] * 16 + kRowY[r] * 4;
  }
  T border[64];
  for (std::size_t s = 0; s < samples.size; ++s) {
    const std::int32_t x = samples.cell[0][s], y = samples.cell[1][s], z = samples.cell[2][s];
    const T* from = reinterpret_cast<const T*>(grid.voxels) + z * stride_z + y * stride_y + x;
    const std::ptrdiff_t* to_row = offset;
    const auto is_inner = [&](int axis) {
      return static_cast<int>(static_cast<std::uint32_t>(samples.cell[axis][s] - 1) < inner[axis]);
    };
    if (HWY_UNLIKELY((is_inner(0) & is_inner(1) & is_inner(2)) == 0)) {
      copy_clamped(grid, x, y, z, border);
      from = border;
      to_row = border_offset;
    }
    for (int r = 0; r < kRows; ++r)
      samples.rows[r][s] = take_row<T, kLabels>(grid, from + to_row[r]);
  }
}

/// Composites the samples front to back.
template <class S>
HWY_INLINE void composite(const RayGrid& grid, const Samples<S>& samples, RayBatch& batch,
                          std::span<RaySample> out, RayCounts& counts) {
  const bool lit = grid.light_volume != nullptr;
  for (std::size_t s = 0; s < samples.size; ++s) {
    const auto i = static_cast<std::size_t>(samples.ray[s]);
    const float left = 1 - batch.alpha[i];
    glm::vec4 color(0);
    for (int k = 0; k < kPieces; ++k) {
      const auto entry = static_cast<std::size_t>(samples.entry[k][s]);
      const glm::vec4& own = grid.table.colors[entry];
      if (lit) {
        const glm::vec4 &light = samples.light[k][s], &albedo = grid.table.albedos[entry];
        color += light * (albedo + light.w * (own - albedo));
      } else {
        color += samples.share[k][s] * own;
      }
    }
    out[batch.ray[i]].rgba += left * color;  // its alpha is set when the ray ends
    const float opacity = left * samples.opacity[s];
    batch.alpha[i] += opacity;
    batch.depth[i] += opacity * (batch.from[i] + samples.center[s] * samples.length[s]);
    counts.visible += samples.opacity[s] > 0;
  }
}

template <class T, bool kLabels>
RayCounts trace_typed(const RayGrid& grid, std::span<const Segment> rays,
                      std::span<RaySample> out) {
  using S = std::conditional_t<kLabels, std::uint8_t, T>;
  RayBatch batch{};
  Samples<S> samples;
  std::fill(out.begin(), out.end(), RaySample{});
  const bool lit = grid.light_volume != nullptr;

  RayCounts counts;
  std::size_t next = 0;
  for (; next < rays.size() && batch.size < kBatch; ++next)
    if (start_ray(grid, rays[next], batch, batch.size)) batch.ray[batch.size++] = next;
  while (batch.size > 0) {
    find_bricks(grid, batch);
    for (std::size_t i = 0; i < batch.size; ++i) {
      const auto brick = static_cast<std::size_t>(batch.brick[i]);
      batch.distance[i] = grid.distance[brick];
      batch.shown[i] = grid.visible_octants[brick] >> batch.bit[i] & 1;
    }
    find_intervals(grid, batch);
    take(batch, samples);
    if (grid.cell_shift) find_rows<T>(grid, samples);
    if (lit || grid.shade)
      load_rows<T, kLabels, 12>(grid, samples);
    else if (!kLabels)
      load_rows<T, kLabels, 4>(grid, samples);
    find_opacity<S, kLabels>(grid, samples);
    if (lit)
      find_light(grid, samples);
    else if (grid.shade)
      shade(grid, samples);
    if (grid.projection == Projection::none)
      composite(grid, samples, batch, out, counts);
    else
      for (std::size_t s = 0; s < samples.size; ++s) project(grid, samples, s, batch);
    counts.steps += batch.size;
    counts.samples += samples.size;
    advance(grid, batch);
    replace_finished(grid, rays, next, batch, out);
  }
  // Early termination skips less opacity than one step of 8 bits: set it to opaque.
  for (RaySample& sample : out)
    if (sample.rgba.a > kOpaque) sample.rgba /= sample.rgba.a;
  return counts;
}

RayCounts trace_any(const RayGrid& grid, std::span<const Segment> rays, std::span<RaySample> out) {
  return with_grid_type(grid.type, [&]<class T>(T) {
    if constexpr (std::is_unsigned_v<T>)
      if (grid.labels) return trace_typed<T, true>(grid, rays, out);
    return trace_typed<T, false>(grid, rays, out);
  });
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(trace_any);

RayCounts trace_rays(const RayGrid& grid, std::span<const Segment> rays, std::span<RaySample> out) {
  return HWY_DYNAMIC_DISPATCH(trace_any)(grid, rays, out);
}

}  // namespace slf
#endif  // HWY_ONCE
