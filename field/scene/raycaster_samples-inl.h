// What the intervals of rays show: opacity, its mean position, and shaded colour. Part of
// raycaster_kernel.cc.

// Included once per instruction set.
#if defined(SLF_FIELD_RAYCASTER_SAMPLES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLF_FIELD_RAYCASTER_SAMPLES_INL_H_
#undef SLF_FIELD_RAYCASTER_SAMPLES_INL_H_
#else
#define SLF_FIELD_RAYCASTER_SAMPLES_INL_H_
#endif

#include <hwy/highway.h>

#include "field/scene/raycaster_rows-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

/// An interval consists of pieces along which the position in the table counts as linear, so that
/// the extinction of a piece is the mean of the table between its ends.
constexpr int kPieces = 3;
/// Each piece is lit at several places, because normals change quickly below a surface.
constexpr int kPoints = 3;
constexpr std::size_t kMaxSamples = 64;

/// Intervals in which a ray may see something, each in one cell of the volume, along which values
/// and gradients are cubic polynomials.
template <class S>
struct Samples {
  std::size_t size = 0;
  alignas(64) Row<S> rows[12][kMaxSamples];
  alignas(64) float start[3][kMaxSamples];   // in the cell, 0 to 1
  alignas(64) float across[3][kMaxSamples];  // from start to end
  alignas(64) float length[kMaxSamples];
  alignas(64) std::int32_t cell[3][kMaxSamples];
  alignas(64) std::int32_t row[kMaxSamples];  // where the row of its structure begins in the table
  std::uint8_t ray[kMaxSamples];              // in the batch
  // Positions in the row, at the ends of the pieces.
  alignas(64) float value[kPieces + 1][kMaxSamples];
  // What the interval adds to the light that enters it, of which each piece adds a share.
  alignas(64) float opacity[kMaxSamples];
  alignas(64) float center[kMaxSamples];  // opacity-weighted mean position, 0 to 1
  alignas(64) float share[kPieces][kMaxSamples];
  alignas(64) float place[kPieces][kMaxSamples];         // mean positions, 0 to 1
  alignas(64) float reach[kPieces][kMaxSamples];         // how far around them most of it is seen
  alignas(64) std::int32_t entry[kPieces][kMaxSamples];  // of the table, for the mean value there
  alignas(64) float light[3][kMaxSamples];               // per channel, times opacity
};

/// Trilinear interpolation between the corners of kLanes cells: those along x at (y, z) = (0, 0),
/// (1, 0), (0, 1) and (1, 1). One axis after the other, which is accurate beside corners that are
/// many orders of magnitude larger.
struct Trilinear {
  Floats first[4], along_x[4];

  HWY_INLINE Floats operator()(const Floats (&p)[3]) const {
    Floats at[4];
    for (int r = 0; r < 4; ++r) at[r] = hn::MulAdd(p[0], along_x[r], first[r]);
    return lerp(lerp(at[0], at[1], p[1]), lerp(at[2], at[3], p[1]), p[2]);
  }
};
HWY_INLINE Trilinear trilinear(const Floats (&x0)[4], const Floats (&x1)[4]) {
  return {{x0[0], x0[1], x0[2], x0[3]},
          {x1[0] - x0[0], x1[1] - x0[1], x1[2] - x0[2], x1[3] - x0[3]}};
}

template <class S>
HWY_INLINE void find_position(const Samples<S>& samples, Floats u, std::size_t i, Floats (&p)[3]) {
  for (int axis = 0; axis < 3; ++axis)
    p[axis] = hn::MulAdd(u, hn::Load(kFloats, samples.across[axis] + i),
                         hn::Load(kFloats, samples.start[axis] + i));
}

/// The position of a value in a row of the table.
HWY_INLINE Floats table_position(const TransferTable& table, Floats value) {
  const Floats last = hn::Set(kFloats, static_cast<float>(table.entries - 1));
  Floats at;
  if (table.logarithmic) {
    const Ints bits = hn::BitCast(kInts, value);
    const Ints int_min = hn::Set(kInts, std::numeric_limits<std::int32_t>::min());
    const Ints ordered = hn::IfThenElse(bits < hn::Zero(kInts), int_min - bits, bits);
    const auto key = hn::BitCast(
        kWords, hn::Max(ordered, hn::Set(kInts, table.low_key)) - hn::Set(kInts, table.low_key));
    // In two parts, as floats do not hold all bits of a key.
    const auto high = hn::ShiftRightSame(key, table.shift);
    const auto low = key - hn::ShiftLeftSame(high, table.shift);
    at = hn::MulAdd(hn::ConvertTo(kFloats, hn::BitCast(kInts, low)),
                    hn::Set(kFloats, std::ldexp(1.f, -table.shift)),
                    hn::ConvertTo(kFloats, hn::BitCast(kInts, high)) - hn::Set(kFloats, 0.5f));
  } else {
    at = (value - hn::Set(kFloats, table.low)) * hn::Set(kFloats, table.scale);
  }
  return hn::Min(hn::Max(at, hn::Zero(kFloats)), last);
}

/// Finds the opacity of each sample and its pieces. Labels are constant along an interval; a row of
/// the table is one label.
template <class S, bool kLabels>
HWY_INLINE void find_opacity(const RayGrid& grid, Samples<S>& samples) {
  const TransferTable& table = grid.table;
  const Floats zero = hn::Zero(kFloats), one = hn::Set(kFloats, 1.f);
  const Floats half = hn::Set(kFloats, 0.5f), piece = hn::Set(kFloats, 1.f / kPieces);
  const Ints last = hn::Set(kInts, static_cast<std::int32_t>(table.entries) - 1);
  for (std::size_t i = 0; i < samples.size; i += kLanes) {
    // Lanes after the last sample hold anything: clamp, so that every access is in the table.
    const Ints end = hn::Set(kInts, static_cast<std::int32_t>(table.integrals.size()) - 1);
    const Ints row = hn::Max(hn::Zero(kInts), hn::Min(hn::Load(kInts, samples.row + i), end));
    Trilinear value;
    if constexpr (!kLabels) {
      Floats x0[4], x1[4];
      for (int r = 0; r < 4; ++r) {
        const Columns c = load_columns(samples.rows[r] + i);
        x0[r] = c.x1;
        x1[r] = c.x2;
      }
      value = trilinear(x0, x1);
    }
    // The places of the pieces' ends in the table.
    Floats at[kPieces + 1], within[kPieces + 1];
    alignas(64) std::int32_t entries[kPieces + 1][kLanes];
    for (int k = 0; k <= kPieces; ++k) {
      Ints entry = hn::Zero(kInts);
      at[k] = zero;
      if constexpr (!kLabels) {
        Floats p[3];
        find_position(samples, hn::Set(kFloats, static_cast<float>(k) / kPieces), i, p);
        at[k] = table_position(table, value(p));
        entry = hn::Min(hn::Max(hn::ConvertTo(kInts, at[k]), entry), last);
      }
      within[k] = at[k] - hn::ConvertTo(kFloats, entry);
      hn::Store(at[k], kFloats, samples.value[k] + i);
      hn::Store(hn::Min(entry + row, end), kInts, entries[k]);
    }
    // Both floats of an entry at once, lane by lane: faster than two gathers.
    alignas(64) TransferTable::Integral integrals[kPieces + 1][kLanes];
    for (int k = 0; k <= kPieces; ++k)
      for (std::size_t lane = 0; lane < kLanes; ++lane)
        integrals[k][lane] = table.integrals[static_cast<std::size_t>(entries[k][lane])];
    // The integral of the extinction up to each of them.
    Floats before[kPieces + 1], extinction[kPieces + 1];
    for (int k = 0; k <= kPieces; ++k) {
      hn::LoadInterleaved2(kFloats, &integrals[k][0].before, before[k], extinction[k]);
      before[k] = hn::MulAdd(within[k], extinction[k], before[k]);
    }
    const Floats length = hn::Load(kFloats, samples.length + i) * piece;
    Floats left = one, center = zero;
    for (int k = 0; k < kPieces; ++k) {
      const Floats change = at[k + 1] - at[k];
      const auto steady = hn::Abs(change) < one;
      const Floats mean =
          hn::IfThenElse(steady, half * (extinction[k] + extinction[k + 1]),
                         (before[k + 1] - before[k]) / hn::IfThenElse(steady, one, change));
      const Floats depth = mean * length;
      const Floats after = left * hn::Exp(kFloats, zero - depth);
      const Floats share = left - after;
      // Where extinction rises or falls, most matter is at one end of the piece: `mass` is its mean
      // position, and `extent` how much of the piece it fills.
      const Floats most = hn::Max(extinction[k], extinction[k + 1]);
      const Floats ratio = hn::Min(mean / hn::Max(most, hn::Set(kFloats, 1e-20f)), one);
      const Floats rising =
          hn::Max(hn::NegMulAdd(hn::Set(kFloats, 2.f / 3), ratio, one),
                  hn::NegMulAdd(hn::Set(kFloats, 1.f / 3), ratio, hn::Set(kFloats, 5.f / 6)));
      const Floats mass = hn::IfThenElse(extinction[k + 1] > extinction[k], rising, one - rising);
      const Floats extent = hn::Min(ratio + ratio, one);
      // The mean position at which light is absorbed, 1/d - 1/(exp(d) - 1), lies before that.
      const Floats d = hn::Min(depth, hn::Set(kFloats, 8.f));
      const Floats before_middle =
          d * hn::MulAdd(d, hn::Set(kFloats, -0.0045f), hn::Set(kFloats, 1.f / 12));
      const Floats middle = hn::NegMulAdd(extent, before_middle, mass);
      const Floats place = piece * (middle + hn::Set(kFloats, static_cast<float>(k)));
      hn::Store(piece * extent * (half - before_middle), kFloats, samples.reach[k] + i);
      hn::Store(share, kFloats, samples.share[k] + i);
      hn::Store(place, kFloats, samples.place[k] + i);
      center = hn::MulAdd(share, place, center);
      const Ints entry = hn::Min(hn::NearestInt(hn::MulAdd(middle, change, at[k])), last);
      hn::Store(row + hn::Max(entry, hn::Zero(kInts)), kInts, samples.entry[k] + i);
      left = after;
    }
    const Floats opacity = one - left;
    const Floats inverse = one / hn::Max(opacity, hn::Set(kFloats, 1e-30f));
    hn::Store(opacity, kFloats, samples.opacity + i);
    hn::Store(center * inverse, kFloats, samples.center + i);
  }
}

/// Multiplies the pieces' shares by ambient and Lambertian light at several places of each, because
/// normals change quickly below a surface. The normal is the trilinear interpolation of central
/// differences, so it has no facets.
template <class S>
HWY_INLINE void shade(const RayGrid& grid, Samples<S>& samples) {
  const Floats one = hn::Set(kFloats, 1.f);
  for (std::size_t i = 0; i < samples.size; i += kLanes) {
    Columns row[12];
    for (int r = 0; r < 12; ++r) row[r] = load_columns(samples.rows[r] + i);
    // Twice the central differences at the corners, by (y, z).
    constexpr int kAbove[2][4] = {{1, 6, 3, 7}, {2, 3, 10, 11}};  // along y, z; see kRowY, kRowZ
    constexpr int kBelow[2][4] = {{4, 0, 5, 2}, {8, 9, 0, 1}};
    Floats x0[3][4], x1[3][4];
    for (int r = 0; r < 4; ++r) {
      x0[0][r] = row[r].x2 - row[r].x0;
      x1[0][r] = row[r].x3 - row[r].x1;
      for (int axis = 0; axis < 2; ++axis) {
        x0[axis + 1][r] = row[kAbove[axis][r]].x1 - row[kBelow[axis][r]].x1;
        x1[axis + 1][r] = row[kAbove[axis][r]].x2 - row[kBelow[axis][r]].x2;
      }
    }
    const Trilinear difference[3] = {trilinear(x0[0], x1[0]), trilinear(x0[1], x1[1]),
                                     trilinear(x0[2], x1[2])};
    Floats light[kPieces];
    for (int point = 0; point < kPieces * kPoints; ++point) {
      const int k = point / kPoints;
      const float offset = (2 * static_cast<float>(point % kPoints) + 1) / kPoints - 1;
      const Floats place =
          hn::MulAdd(hn::Set(kFloats, offset), hn::Load(kFloats, samples.reach[k] + i),
                     hn::Load(kFloats, samples.place[k] + i));
      Floats p[3];
      find_position(samples, place, i, p);
      const Floats d[3] = {difference[0](p), difference[1](p), difference[2](p)};
      // Transform the gradient to world coordinates.
      const auto& m = grid.gradient_to_world;
      Floats toward = hn::Zero(kFloats), length2 = hn::Set(kFloats, 1e-30f);
      for (int axis = 0; axis < 3; ++axis) {
        const Floats n = hn::MulAdd(hn::Set(kFloats, 0.5f * m[0][axis]), d[0],
                                    hn::MulAdd(hn::Set(kFloats, 0.5f * m[1][axis]), d[1],
                                               hn::Set(kFloats, 0.5f * m[2][axis]) * d[2]));
        toward = hn::NegMulAdd(n, hn::Set(kFloats, grid.light[axis]), toward);
        length2 = hn::MulAdd(n, n, length2);
      }
      // Small gradients are unreliable: fade their shading out.
      const Floats length = hn::Sqrt(length2);
      const Floats lambert = hn::Max(hn::Zero(kFloats), toward) / length;
      const Floats sure = hn::Min(one, length * hn::Set(kFloats, grid.inverse_gradient_floor));
      const Floats dark = hn::Set(kFloats, 1 - grid.ambient) * (one - lambert);
      const Floats shown = hn::NegMulAdd(dark, sure, one);
      light[k] = point % kPoints == 0 ? shown : light[k] + shown;
    }
    for (int k = 0; k < kPieces; ++k) {
      const Floats share = hn::Load(kFloats, samples.share[k] + i);
      hn::Store(share * light[k] * hn::Set(kFloats, 1.f / kPoints), kFloats, samples.share[k] + i);
    }
  }
}

/// RGB light at kLanes samples, trilinear between the nodes of the light volume.
struct Light {
  Floats rgb[3];
};
HWY_INLINE Light look_up(const LightGrid& grid, const Floats (&at)[3]) {
  const Ints zero = hn::Zero(kInts), one = hn::Set(kInts, 1);
  Floats share[3][2];
  Ints first = zero, step[3];
  for (int axis = 2; axis >= 0; --axis) {
    const Ints last = hn::Set(kInts, grid.dims[axis] - 1);
    const Floats p = hn::Max(hn::Zero(kFloats), at[axis]);
    // Lanes after the last sample hold anything: clamp, so that every access is in the grid.
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

/// The normal of the volume within a cell, of unit length in voxels; 0 where it is constant or
/// values are too large. `to_normal` turns a gradient into a normal, both in voxel indices.
template <class S>
HWY_INLINE void find_normal(const Samples<S>& samples, std::size_t i, const Floats (&p)[3],
                            const glm::mat3& to_normal, Floats (&normal)[3]) {
  Floats step[4], at[4];
  for (int r = 0; r < 4; ++r) {
    const Columns c = load_columns(samples.rows[r] + i);
    step[r] = c.x2 - c.x1;
    at[r] = hn::MulAdd(p[0], step[r], c.x1);
  }
  const Floats gradient[3] = {
      lerp(lerp(step[0], step[1], p[1]), lerp(step[2], step[3], p[1]), p[2]),
      lerp(at[1] - at[0], at[3] - at[2], p[2]), lerp(at[2] - at[0], at[3] - at[1], p[1])};
  Floats length2 = hn::Set(kFloats, 1e-30f);
  for (int axis = 0; axis < 3; ++axis) {
    normal[axis] = hn::Zero(kFloats);
    for (int k = 0; k < 3; ++k)
      normal[axis] = hn::MulAdd(hn::Set(kFloats, to_normal[k][axis]), gradient[k], normal[axis]);
    length2 = hn::MulAdd(normal[axis], normal[axis], length2);
  }
  const auto finite = hn::IsFinite(length2);
  const Floats inverse = hn::Set(kFloats, 1.f) / hn::Sqrt(length2);
  for (Floats& n : normal) n = hn::IfThenElseZero(finite, n * inverse);
}

/// Finds the light at each sample, from the light volume.
template <class S>
HWY_INLINE void find_light(const RayGrid& grid, Samples<S>& samples) {
  const LightGrid& light = grid.light_volume;
  const auto spacing = static_cast<float>(light.spacing);
  const auto& m = grid.gradient_to_world;
  const glm::mat3 to_normal = -grid.inverse_gradient_floor * glm::mat3(grid.world_to_index) *
                              glm::mat3(glm::vec3(m[0]), glm::vec3(m[1]), glm::vec3(m[2]));
  for (std::size_t i = 0; i < samples.size; i += kLanes) {
    Floats at[3], normal[3], length2 = hn::Set(kFloats, 1e-12f);
    find_position(samples, hn::Load(kFloats, samples.center + i), i, at);
    find_normal(samples, i, at, to_normal, normal);
    for (int axis = 0; axis < 3; ++axis) {
      const Floats across = hn::Load(kFloats, samples.across[axis] + i);
      length2 = hn::MulAdd(across, across, length2);
    }
    const Floats opacity =
        hn::Min(hn::Load(kFloats, samples.opacity + i) / hn::Sqrt(length2), hn::Set(kFloats, 1.f));
    const Floats beside = hn::Set(kFloats, kLookUpBeside * spacing) * opacity;
    for (int axis = 0; axis < 3; ++axis) {
      const Floats cell = hn::ConvertTo(kFloats, hn::Load(kInts, samples.cell[axis] + i)) -
                          hn::Set(kFloats, static_cast<float>(light.low[axis]));
      at[axis] = hn::MulAdd(beside, normal[axis], at[axis] + cell) * hn::Set(kFloats, 1 / spacing);
    }
    const Light found = look_up(light, at);
    for (int c = 0; c < 3; ++c) hn::Store(found.rgb[c], kFloats, samples.light[c] + i);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#endif
