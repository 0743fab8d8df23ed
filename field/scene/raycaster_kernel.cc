#include "field/scene/raycaster_kernel.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/scene/raycaster_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set
#include <hwy/highway.h>

#include "field/scene/raycaster_rows-inl.h"
#include "field/scene/raycaster_shading-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

// kBatch rays advance together, by one sample per pass. A pass alternates between two kinds of
// short loops over the batch: vector arithmetic, and look-ups lane by lane. So neither waits for
// the other, and their data stay in the first-level cache. Lanes do not mix: a ray's sample does
// not depend on the other rays.
constexpr std::size_t kBatch = 64;
static_assert(kBatch % kLanes == 0 && kHits >= 2 * kBatch);

/// The rays that are being traced. Ray i of the batch is element i of each array. Positions are in
/// voxel indices.
struct RayBatch {
  std::size_t size = 0;
  // The ray: sample k of `count` is at start + k·delta.
  alignas(64) float start[3][kBatch];
  alignas(64) float delta[3][kBatch];
  alignas(64) float inverse[3][kBatch];
  alignas(64) std::int32_t k[kBatch];
  alignas(64) std::int32_t count[kBatch];
  double first[kBatch];  // distance of sample 0 from the ray's beginning, in steps
  double steps[kBatch];  // length of the ray in steps
  std::size_t ray[kBatch];
  // The result so far, except its colour.
  alignas(64) float alpha[kBatch];
  alignas(64) float depth[kBatch];
  // Its next sample.
  alignas(64) std::int32_t cell[3][kBatch];
  alignas(64) float within[3][kBatch];
  alignas(64) std::int32_t brick[kBatch];
  alignas(64) std::int32_t distance[kBatch];
  alignas(64) std::int32_t entry[kBatch];
};

/// Puts a ray into place i of the batch. False: it misses the visible box.
bool start_ray(const RayGrid& grid, const Segment& segment, RayBatch& batch, std::size_t i) {
  // Find the range of steps inside the visible box.
  const double length = glm::distance(segment.from, segment.to);
  if (!(length > 0)) return false;
  const glm::dvec3 a = grid.world_to_index * (segment.from - grid.origin);
  const glm::dvec3 delta = grid.world_to_index * (segment.to - segment.from) * (grid.step / length);
  double low = 0, high = length / grid.step;
  batch.steps[i] = high;
  for (int axis = 0; axis < 3; ++axis) {
    const double from_low = grid.visible_low[axis] - a[axis];
    const double from_high = grid.visible_high[axis] - a[axis];
    if (std::abs(delta[axis]) < 1e-12) {
      if (from_low > 0 || from_high < 0) return false;
      batch.inverse[axis][i] = std::numeric_limits<float>::lowest();  // as leap() requires
      continue;
    }
    const double inverse = 1 / delta[axis];
    const double t0 = from_low * inverse, t1 = from_high * inverse;
    low = std::max(low, std::min(t0, t1));
    high = std::min(high, std::max(t0, t1));
    batch.inverse[axis][i] = static_cast<float>(inverse);
  }
  if (!(low < high)) return false;
  // Sample k of the whole ray is at k + 0.5 steps. The box only selects samples, it moves none.
  const double first = std::ceil(low - 0.5);
  const double count = std::floor(high - 0.5) + 1 - first;
  if (!(count > 0)) return false;
  const glm::dvec3 start = a + delta * (first + 0.5);
  for (int axis = 0; axis < 3; ++axis) {
    batch.start[axis][i] = static_cast<float>(start[axis]);
    batch.delta[axis][i] = static_cast<float>(delta[axis]);
  }
  batch.k[i] = 0;
  batch.count[i] = static_cast<std::int32_t>(std::min(count, 1e9));
  batch.first[i] = first + 0.5;
  batch.alpha[i] = batch.depth[i] = 0;
  return true;
}

void move_ray(RayBatch& batch, std::size_t from, std::size_t to) {
  for (int axis = 0; axis < 3; ++axis) {
    batch.start[axis][to] = batch.start[axis][from];
    batch.delta[axis][to] = batch.delta[axis][from];
    batch.inverse[axis][to] = batch.inverse[axis][from];
  }
  batch.k[to] = batch.k[from];
  batch.count[to] = batch.count[from];
  batch.first[to] = batch.first[from];
  batch.steps[to] = batch.steps[from];
  batch.ray[to] = batch.ray[from];
  batch.alpha[to] = batch.alpha[from];
  batch.depth[to] = batch.depth[from];
}

/// Finds each ray's next sample: its cell, the position in the cell, and the brick.
HWY_INLINE void locate(const RayGrid& grid, RayBatch& batch) {
  const Ints zero = hn::Zero(kInts);
  for (std::size_t i = 0; i < batch.size; i += kLanes) {
    const Floats k = hn::ConvertTo(kFloats, hn::Load(kInts, batch.k + i));
    Ints brick = zero;
    for (int axis = 2; axis >= 0; --axis) {
      const Floats p = hn::MulAdd(k, hn::Load(kFloats, batch.delta[axis] + i),
                                  hn::Load(kFloats, batch.start[axis] + i));
      // Rounding may move a sample out of the box; clamp, so that every access is in the volume.
      const Ints cell =
          hn::Min(hn::Max(hn::ConvertTo(kInts, p), zero), hn::Set(kInts, grid.dims[axis] - 2));
      hn::Store(cell, kInts, batch.cell[axis] + i);
      hn::Store(p - hn::ConvertTo(kFloats, cell), kFloats, batch.within[axis] + i);
      brick = brick * hn::Set(kInts, grid.bricks[axis]) + hn::ShiftRight<kBrickShift>(cell);
    }
    hn::Store(brick, kInts, batch.brick + i);
  }
}

/// Advances each ray to its next sample or, if its brick is empty, by as many steps as stay inside
/// the empty cube of bricks around it.
HWY_INLINE void advance(RayBatch& batch) {
  const Ints one = hn::Set(kInts, 1);
  for (std::size_t i = 0; i < batch.size; i += kLanes) {
    const Ints distance = hn::Load(kInts, batch.distance + i);
    Floats steps = hn::Set(kFloats, 1e9f);
    for (int axis = 0; axis < 3; ++axis) {
      const Ints cell = hn::Load(kInts, batch.cell[axis] + i);
      const Floats within = hn::Load(kFloats, batch.within[axis] + i);
      const Floats inverse = hn::Load(kFloats, batch.inverse[axis] + i);
      const Ints brick = hn::ShiftRight<kBrickShift>(cell);
      const auto up = hn::RebindMask(kInts, inverse > hn::Zero(kFloats));
      const Ints edge = hn::IfThenElse(up, brick + distance, brick - distance + one);
      const Ints cells = hn::ShiftLeft<kBrickShift>(edge) - cell;
      steps = hn::Min(steps, (hn::ConvertTo(kFloats, cells) - within) * inverse);
    }
    const auto leaps = distance > hn::Zero(kInts);
    const Ints by = hn::IfThenElse(leaps, hn::Max(one, hn::ConvertTo(kInts, steps)), one);
    hn::Store(hn::Load(kInts, batch.k + i) + by, kInts, batch.k + i);
  }
}

/// The table index of each value, which is trilinear between the eight voxels of the cell.
template <class T>
HWY_INLINE void find_entries(const TransferTable& table, const Row<T> (&rows)[4][kBatch],
                             RayBatch& batch) {
  const auto last = static_cast<std::int32_t>(table.entries) - 1;
  for (std::size_t i = 0; i < batch.size; i += kLanes) {
    const Floats fx = hn::Load(kFloats, batch.within[0] + i);
    const Floats fy = hn::Load(kFloats, batch.within[1] + i);
    const Floats fz = hn::Load(kFloats, batch.within[2] + i);
    Floats along_x[4];
    for (int r = 0; r < 4; ++r) {
      const Columns c = load_columns(rows[r] + i);
      along_x[r] = lerp(c.x1, c.x2, fx);
    }
    const Floats value =
        lerp(lerp(along_x[0], along_x[1], fy), lerp(along_x[2], along_x[3], fy), fz);
    Ints entry;
    if (table.logarithmic) {
      const Ints bits = hn::BitCast(kInts, value);
      const Ints int_min = hn::Set(kInts, std::numeric_limits<std::int32_t>::min());
      const Ints ordered = hn::IfThenElse(bits < hn::Zero(kInts), int_min - bits, bits);
      const auto key = hn::BitCast(
          kWords, hn::Max(ordered, hn::Set(kInts, table.low_key)) - hn::Set(kInts, table.low_key));
      entry = hn::BitCast(kInts, hn::Min(hn::ShiftRightSame(key, table.shift),
                                         hn::Set(kWords, static_cast<std::uint32_t>(last))));
    } else {
      const Floats at = hn::MulAdd(value - hn::Set(kFloats, table.low),
                                   hn::Set(kFloats, table.scale), hn::Set(kFloats, 0.5f));
      const Floats last_entry = hn::Set(kFloats, static_cast<float>(last));
      entry = hn::ConvertTo(kInts, hn::Min(hn::Max(at, hn::Zero(kFloats)), last_entry));
    }
    hn::Store(entry, kInts, batch.entry + i);
  }
}

/// Moves the entry of ray i's sample to the row of its structure.
HWY_INLINE void find_row(const RayGrid& grid, RayBatch& batch, std::size_t i) {
  std::size_t voxel = 0;
  for (int axis = 2; axis >= 0; --axis)
    voxel = voxel * static_cast<std::size_t>(grid.dims[axis]) +
            static_cast<std::size_t>(batch.cell[axis][i] + (batch.within[axis][i] >= 0.5f));
  batch.entry[i] += grid.rows[voxel] * static_cast<std::int32_t>(grid.table.entries);
}

constexpr float kOpaque = 1 - 1.f / 256;

/// Removes the rays that have ended, and replaces them by new rays or by the batch's last ones.
void replace_finished(const RayGrid& grid, std::span<const Segment> rays, std::size_t& next,
                      RayBatch& batch, std::span<RaySample> out) {
  const auto finished = [&](std::size_t i) {
    return batch.k[i] >= batch.count[i] || batch.alpha[i] > kOpaque;
  };
  // Backwards, so that a ray that moves down was checked before.
  for (std::size_t group = (batch.size + kLanes - 1) / kLanes; group-- > 0;) {
    const std::size_t begin = group * kLanes;
    const auto going = hn::Load(kInts, batch.count + begin) > hn::Load(kInts, batch.k + begin);
    const auto opaque = hn::Load(kFloats, batch.alpha + begin) > hn::Set(kFloats, kOpaque);
    if (hn::AllTrue(kInts, hn::AndNot(hn::RebindMask(kInts, opaque), going))) continue;
    for (std::size_t i = std::min(begin + kLanes, batch.size); i-- > begin;) {
      if (!finished(i)) continue;
      RaySample& sample = out[batch.ray[i]];
      sample.rgba.a = batch.alpha[i];
      if (sample.rgba.a > 0)
        sample.depth = static_cast<float>(std::clamp(
            (batch.first[i] + batch.depth[i] / batch.alpha[i]) / batch.steps[i], 0.0, 1.0));
      while (next < rays.size() && !start_ray(grid, rays[next], batch, i)) ++next;
      if (next < rays.size())
        batch.ray[i] = next++;
      else
        move_ray(batch, --batch.size, i);
    }
  }
}

template <class T, bool kLabels>
RayCounts trace_typed(const RayGrid& grid, std::span<const Segment> rays,
                      std::span<RaySample> out) {
  using S = std::conditional_t<kLabels, std::uint8_t, T>;
  RayBatch batch{};
  Hits<S> hits;
  alignas(64) Row<T> rows[4][kBatch];
  T border[64];
  std::fill(out.begin(), out.end(), RaySample{});

  const LightGrid& volume = grid.light_volume;
  const bool lit = !volume.nodes.empty();
  const glm::vec3 node_scale(1 / volume.spacing);
  const glm::vec3 node_offset(-volume.low / volume.spacing);
  const auto finish = [&] {
    if (lit)
      light(grid, hits, out);
    else
      shade(grid, hits, out);
  };

  RayCounts counts;
  std::size_t next = 0;
  for (; next < rays.size() && batch.size < kBatch; ++next)
    if (start_ray(grid, rays[next], batch, batch.size)) batch.ray[batch.size++] = next;
  while (batch.size > 0) {
    // Find the rays whose next sample is not in empty space.
    locate(grid, batch);
    std::uint8_t sampling[kBatch];
    std::size_t samples = 0;
    for (std::size_t i = 0; i < batch.size; ++i) {
      const int distance = grid.distance[static_cast<std::size_t>(batch.brick[i])];
      const bool empty = distance > 0 && grid.leap;
      batch.distance[i] = empty ? distance : 0;
      sampling[samples] = static_cast<std::uint8_t>(i);
      samples += !empty;
    }
    counts.steps += batch.size;
    counts.samples += samples;
    // Load the voxels of their cells.
    for (std::size_t s = 0; s < samples; ++s) {
      const std::size_t i = sampling[s];
      const int x = batch.cell[0][i], y = batch.cell[1][i], z = batch.cell[2][i];
      const Neighbourhood<T> voxels = neighbourhood(grid, x, y, z, border);
      if constexpr (kLabels) {
        const int up[3] = {batch.within[0][i] >= 0.5f, batch.within[1][i] >= 0.5f,
                           batch.within[2][i] >= 0.5f};
        batch.entry[i] = voxels.at(1 + up[1], 1 + up[2])[1 + up[0]];
      } else {
        for (int r = 0; r < 4; ++r)
          std::memcpy(&rows[r][i], voxels.at(kRowY[r], kRowZ[r]), sizeof rows[r][i]);
      }
    }
    if constexpr (!kLabels) find_entries(grid.table, rows, batch);
    if (!grid.rows.empty())
      for (std::size_t s = 0; s < samples; ++s) find_row(grid, batch, sampling[s]);
    // Composite opacity front to back. Colour follows when the samples are shaded.
    for (std::size_t s = 0; s < samples; ++s) {
      const std::size_t i = sampling[s];
      const auto entry = static_cast<std::size_t>(batch.entry[i]);
      if (kLabels && entry >= grid.table.opacities.size()) continue;
      const float opacity = grid.table.opacities[entry];
      if (opacity <= 0) continue;
      const float weight = (1 - batch.alpha[i]) * opacity;
      ++counts.visible;
      batch.alpha[i] += weight;
      batch.depth[i] += weight * static_cast<float>(batch.k[i]);
      if (!grid.shade && !lit) {
        add_color(grid, batch.entry[i], weight, out[batch.ray[i]].rgba);
        continue;
      }
      const std::size_t h = hits.size++;
      hits.weight[h] = weight;
      hits.entry[h] = batch.entry[i];
      hits.ray[h] = batch.ray[i];
      if (lit) {
        for (int axis = 0; axis < 3; ++axis)
          hits.at[axis][h] =
              (static_cast<float>(batch.cell[axis][i]) + batch.within[axis][i]) * node_scale[axis] +
              node_offset[axis];
        continue;
      }
      const Neighbourhood<T> voxels =
          neighbourhood(grid, batch.cell[0][i], batch.cell[1][i], batch.cell[2][i], border);
      for (int r = 0; r < 12; ++r)
        hits.rows[r][h] = take_row<T, kLabels>(grid, voxels.at(kRowY[r], kRowZ[r]));
      for (int axis = 0; axis < 3; ++axis) hits.within[axis][h] = batch.within[axis][i];
    }
    if (hits.size > kHits - kBatch) finish();
    advance(batch);
    replace_finished(grid, rays, next, batch, out);
  }
  finish();
  // Early termination skips less opacity than one step of 8 bits: set it to opaque.
  for (RaySample& sample : out)
    if (sample.rgba.a > kOpaque) sample.rgba /= sample.rgba.a;
  return counts;
}

RayCounts trace_any(const RayGrid& grid, std::span<const Segment> rays, std::span<RaySample> out) {
  switch (grid.type) {
    case ScalarType::u8:
      return grid.labels ? trace_typed<std::uint8_t, true>(grid, rays, out)
                         : trace_typed<std::uint8_t, false>(grid, rays, out);
    case ScalarType::u16:
      return grid.labels ? trace_typed<std::uint16_t, true>(grid, rays, out)
                         : trace_typed<std::uint16_t, false>(grid, rays, out);
    case ScalarType::i8:
      return trace_typed<std::int8_t, false>(grid, rays, out);
    case ScalarType::i16:
      return trace_typed<std::int16_t, false>(grid, rays, out);
    default:
      return trace_typed<float, false>(grid, rays, out);
  }
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
