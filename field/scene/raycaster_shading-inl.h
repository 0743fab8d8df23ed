// Visible samples and their shading. Part of raycaster_kernel.cc.

// Included once per instruction set.
#if defined(SLF_FIELD_RAYCASTER_SHADING_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLF_FIELD_RAYCASTER_SHADING_INL_H_
#undef SLF_FIELD_RAYCASTER_SHADING_INL_H_
#else
#define SLF_FIELD_RAYCASTER_SHADING_INL_H_
#endif

#include <hwy/highway.h>

#include <span>

#include "field/scene/raycaster_rows-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

constexpr std::size_t kHits = 128;

/// Visible samples that are not shaded yet.
template <class S>
struct Hits {
  std::size_t size = 0;
  alignas(64) Row<S> rows[12][kHits];
  alignas(64) float within[3][kHits];
  alignas(64) float at[3][kHits];  // with a light volume: the position in its nodes
  alignas(64) float weight[kHits];
  std::int32_t entry[kHits];
  std::size_t ray[kHits];
};

/// Ambient and Lambertian light at kLanes hits. The normal is the trilinear interpolation of
/// central differences, so it has no facets.
template <class S>
HWY_INLINE Floats shading(const RayGrid& grid, const Hits<S>& hits, std::size_t i) {
  const Floats one = hn::Set(kFloats, 1.f);
  const Floats fx = hn::Load(kFloats, hits.within[0] + i);
  const Floats fy = hn::Load(kFloats, hits.within[1] + i);
  const Floats fz = hn::Load(kFloats, hits.within[2] + i);
  // Interpolate the outer rows along x; the inner ones also across it.
  Floats row[12];
  for (int r = 4; r < 12; ++r) {
    const Columns c = load_columns(hits.rows[r] + i);
    row[r] = lerp(c.x1, c.x2, fx);
  }
  Columns inner[4];
  for (int r = 0; r < 4; ++r) {
    inner[r] = load_columns(hits.rows[r] + i);
    row[r] = lerp(inner[r].x1, inner[r].x2, fx);
  }
  const auto face = [&](Floats Columns::*x) {
    return lerp(lerp(inner[0].*x, inner[1].*x, fy), lerp(inner[2].*x, inner[3].*x, fy), fz);
  };
  // Compute twice the difference along each axis.
  const Floats dx =
      lerp(face(&Columns::x2) - face(&Columns::x0), face(&Columns::x3) - face(&Columns::x1), fx);
  const Floats dy = lerp(lerp(row[1] - row[4], row[6] - row[0], fy),
                         lerp(row[3] - row[5], row[7] - row[2], fy), fz);
  const Floats dz = lerp(lerp(row[2] - row[8], row[10] - row[0], fz),
                         lerp(row[3] - row[9], row[11] - row[1], fz), fy);
  // Transform the gradient to world coordinates.
  const auto& m = grid.gradient_to_world;
  Floats toward = hn::Zero(kFloats), length2 = hn::Set(kFloats, 1e-30f);
  for (int axis = 0; axis < 3; ++axis) {
    const Floats n = hn::MulAdd(hn::Set(kFloats, 0.5f * m[0][axis]), dx,
                                hn::MulAdd(hn::Set(kFloats, 0.5f * m[1][axis]), dy,
                                           hn::Set(kFloats, 0.5f * m[2][axis]) * dz));
    toward = hn::NegMulAdd(n, hn::Set(kFloats, grid.light[axis]), toward);
    length2 = hn::MulAdd(n, n, length2);
  }
  // Small gradients are unreliable: fade their shading out.
  const Floats length = hn::Sqrt(length2);
  const Floats lambert = hn::Max(hn::Zero(kFloats), toward) / length;
  const Floats sure = hn::Min(one, length * hn::Set(kFloats, grid.inverse_gradient_floor));
  return hn::NegMulAdd(hn::Set(kFloats, 1 - grid.ambient) * (one - lambert), sure, one);
}

/// RGB light at kLanes hits, trilinear between the nodes of the light volume.
struct Light {
  Floats rgb[3];
};
template <class S>
HWY_INLINE Light look_up(const LightGrid& grid, const Hits<S>& hits, std::size_t i) {
  const Ints zero = hn::Zero(kInts), one = hn::Set(kInts, 1);
  Floats share[3][2];
  Ints first = zero, step[3];
  for (int axis = 2; axis >= 0; --axis) {
    const Ints last = hn::Set(kInts, grid.dims[axis] - 1);
    const Floats p = hn::Max(hn::Zero(kFloats), hn::Load(kFloats, hits.at[axis] + i));
    // Lanes after the last hit hold anything: clamp, so that every access is in the grid.
    const Ints cell = hn::Max(zero, hn::Min(hn::ConvertTo(kInts, p), last));
    share[axis][1] = hn::Min(p - hn::ConvertTo(kFloats, cell), hn::Set(kFloats, 1.f));
    share[axis][0] = hn::Set(kFloats, 1.f) - share[axis][1];
    step[axis] = hn::Min(one, last - cell);  // 0 in the last node of an axis
    first = first * hn::Set(kInts, grid.dims[axis]) + cell;
  }
  step[1] = step[1] * hn::Set(kInts, grid.dims[0]);
  step[2] = step[2] * hn::Set(kInts, grid.dims[0] * grid.dims[1]);
  Light light{{hn::Zero(kFloats), hn::Zero(kFloats), hn::Zero(kFloats)}};
  for (int corner = 0; corner < 8; ++corner) {
    const int x = corner & 1, y = corner >> 1 & 1, z = corner >> 2;
    Ints node = first;
    if (x) node = node + step[0];
    if (y) node = node + step[1];
    if (z) node = node + step[2];
    // pack_light() says what is in a word. Scale by 2^(e - 24).
    const auto word = hn::GatherIndex(kWords, grid.nodes.data(), node);
    const auto exponent = hn::ShiftRight<27>(word) + hn::Set(kWords, 127 - 24);
    const Floats scale = hn::BitCast(kFloats, hn::ShiftLeft<23>(exponent)) *
                         (share[0][x] * share[1][y] * share[2][z]);
    const auto add = [&](Floats& to, auto shifted) {
      const auto mantissa = hn::And(shifted, hn::Set(kWords, 511));
      to = hn::MulAdd(hn::ConvertTo(kFloats, hn::BitCast(kInts, mantissa)), scale, to);
    };
    add(light.rgb[0], word);
    add(light.rgb[1], hn::ShiftRight<9>(word));
    add(light.rgb[2], hn::ShiftRight<18>(word));
  }
  return light;
}

HWY_INLINE void add_color(const RayGrid& grid, std::int32_t entry, float weight, glm::vec4& to) {
  const glm::vec4& color = grid.table.colors[static_cast<std::size_t>(entry)];
  for (int c = 0; c < 3; ++c) to[c] += weight * color[c];
}

/// As shade(), with a light volume.
template <class S>
HWY_NOINLINE void light(const RayGrid& grid, Hits<S>& hits, std::span<RaySample> out) {
  alignas(64) float rgb[3][kHits];
  for (std::size_t i = 0; i < hits.size; i += kLanes) {
    const Light found = look_up(grid.light_volume, hits, i);
    const Floats weight = hn::Load(kFloats, hits.weight + i);
    for (int c = 0; c < 3; ++c) hn::Store(weight * found.rgb[c], kFloats, rgb[c] + i);
  }
  for (std::size_t i = 0; i < hits.size; ++i) {  // in order along each ray
    const glm::vec4& color = grid.table.colors[static_cast<std::size_t>(hits.entry[i])];
    glm::vec4& to = out[hits.ray[i]].rgba;
    for (int c = 0; c < 3; ++c) to[c] += rgb[c][i] * color[c];
  }
  hits.size = 0;
}

template <class S>
HWY_NOINLINE void shade(const RayGrid& grid, Hits<S>& hits, std::span<RaySample> out) {
  for (std::size_t i = 0; i < hits.size; i += kLanes)
    hn::Store(hn::Load(kFloats, hits.weight + i) * shading(grid, hits, i), kFloats,
              hits.weight + i);
  for (std::size_t i = 0; i < hits.size; ++i)  // in order along each ray
    add_color(grid, hits.entry[i], hits.weight[i], out[hits.ray[i]].rgba);
  hits.size = 0;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#endif
