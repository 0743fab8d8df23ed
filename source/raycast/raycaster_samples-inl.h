// What the intervals of rays show: opacity, its mean position, and colour under direct light. Part
// of raycaster_kernel.cc.

// Included once per instruction set.
#if defined(SLF_FIELD_RAYCASTER_SAMPLES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLF_FIELD_RAYCASTER_SAMPLES_INL_H_
#undef SLF_FIELD_RAYCASTER_SAMPLES_INL_H_
#else
#define SLF_FIELD_RAYCASTER_SAMPLES_INL_H_
#endif

#include <hwy/highway.h>

#include "source/raycast/raycaster_rows-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

/// An interval consists of pieces along which the position in the table counts as linear, so that
/// the extinction of a piece is the mean of the table between its ends.
constexpr int kPieces = 3;
/// Each piece is lit at several places, because normals change quickly below a surface.
constexpr int kPoints = 3;
constexpr std::size_t kMaxSamples = 128;
/// Writes of whole vectors end behind the last sample.
constexpr std::size_t kPadded = kMaxSamples + kLanes;

/// Intervals in which a ray may see something, each in one cell of the volume, along which values
/// and gradients are cubic polynomials. Behind the last one, arrays hold anything.
template <class S>
struct Samples {  // NOLINT(clang-analyzer-optin.performance.Padding): whole vectors
  std::size_t size = 0;
  alignas(64) Row<S> rows[12][kPadded];
  alignas(64) float start[3][kPadded];   // in the cell, 0 to 1
  alignas(64) float across[3][kPadded];  // from start to end
  alignas(64) float length[kPadded];
  alignas(64) std::int32_t cell[3][kPadded];
  alignas(64) std::int32_t row[kPadded] = {};  // where that of its structure begins in the table
  alignas(64) std::int32_t ray[kPadded];       // in the batch
  // Positions in the row, at the ends of the pieces.
  alignas(64) float value[kPieces + 1][kPadded];
  // What the interval adds to the light that enters it, of which each piece adds a share.
  alignas(64) float opacity[kPadded];
  alignas(64) float center[kPadded];  // opacity-weighted mean position, 0 to 1
  alignas(64) float share[kPieces][kPadded];
  alignas(64) float place[kPieces][kPadded];         // mean positions, 0 to 1
  alignas(64) float reach[kPieces][kPadded];         // how far around them most of it is seen
  alignas(64) std::int32_t entry[kPieces][kPadded];  // of the table, for the mean value there
  // With a light volume: RGB light at a piece times its share, and how much of it is a surface.
  alignas(64) glm::vec4 light[kPieces][kPadded];
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
    p[axis] = hn::MulAdd(u, load(samples.across[axis] + i), load(samples.start[axis] + i));
}

/// The position of a value in a row of the table.
HWY_INLINE Floats table_position(const TransferTable& table, Floats value) {
  const Floats last = floats(table.entries - 1);
  Floats at;
  if (table.logarithmic) {
    const Ints bits = hn::BitCast(kInts, value);
    const Ints int_min = ints(std::numeric_limits<std::int32_t>::min());
    const Ints ordered = hn::IfThenElse(bits < ints(0), int_min - bits, bits);
    const auto key =
        hn::BitCast(kWords, hn::Max(ordered, ints(table.low_key)) - ints(table.low_key));
    // In two parts, as floats do not hold all bits of a key.
    const auto high = hn::ShiftRightSame(key, table.shift);
    const auto low = key - hn::ShiftLeftSame(high, table.shift);
    at = hn::MulAdd(hn::ConvertTo(kFloats, hn::BitCast(kInts, low)),
                    floats(std::ldexp(1.f, -table.shift)),
                    hn::ConvertTo(kFloats, hn::BitCast(kInts, high)) - floats(0.5f));
  } else {
    at = (value - floats(table.low)) * floats(table.scale);
  }
  return hn::Min(hn::Max(at, floats(0)), last);
}

/// The integrals at kLanes entries of the table.
HWY_INLINE void load_integrals(const TransferTable& table, Ints entry, Floats& before,
                               Floats& extinction) {
#if HWY_TARGET == HWY_SCALAR
  const float* integrals = &table.integrals[0].before;
  before = hn::GatherIndex(kFloats, integrals, hn::ShiftLeft<1>(entry));
  extinction = hn::GatherIndex(kFloats, integrals + 1, hn::ShiftLeft<1>(entry));
#else
  // Both floats of an entry at once.
  constexpr hn::ScalableTag<std::int64_t> pairs;
  constexpr hn::Half<decltype(kInts)> half;
  const auto* integrals = reinterpret_cast<const std::int64_t*>(table.integrals.data());
  const auto gather = [&](auto entries) {
    return hn::BitCast(kFloats, hn::GatherIndex(pairs, integrals, hn::PromoteTo(pairs, entries)));
  };
  const Floats low = gather(hn::LowerHalf(half, entry)), high = gather(hn::UpperHalf(half, entry));
  before = hn::ConcatEven(kFloats, high, low);
  extinction = hn::ConcatOdd(kFloats, high, low);
#endif
}

/// Colours of a piece that change by more, times its share of what is seen, are refined.
constexpr float kSteep = 1.f / 16;

/// Finds the entry of a steep piece, where its mean position is uncertain: the mean of its parts,
/// by what is seen of each.
template <class S>
void refine_entry(const TransferTable& table, Samples<S>& samples, int k, std::size_t s) {
  constexpr int kParts = 8;
  const float from = samples.value[k][s] + 0.5f, change = samples.value[k + 1][s] + 0.5f - from;
  const auto entry = [&](float part) {
    return samples.row[s] + static_cast<std::int32_t>(from + part * change);
  };
  const float length = samples.length[s] / (kPieces * kParts);
  float left = 1, mean = 0;
  for (int part = 0; part < kParts; ++part) {
    const float middle = (static_cast<float>(part) + 0.5f) / kParts;
    // exp(-depth) by Padé: the library's has other last bits on other processors.
    const float depth = table.extinctions[static_cast<std::size_t>(entry(middle))] * length;
    const float even = 1 + depth * depth / 12, odd = depth / 2;
    const float passes = (even - odd) / (even + odd);
    mean += left * (1 - passes) * middle;
    left *= passes;
  }
  if (left < 1) samples.entry[k][s] = entry(mean / (1 - left));
}

/// The same for those of kLanes pieces, from sample `i` on, if they are steep.
/// `entries`: those at the ends of the pieces.
template <class S>
HWY_NOINLINE void refine_entries(const TransferTable& table, Samples<S>& samples, int k,
                                 std::size_t i, const Ints (&entries)[kPieces + 1], Floats share) {
  const float* const path = table.color_path.data();
  const Floats change =
      hn::GatherIndex(kFloats, path, entries[k + 1]) - hn::GatherIndex(kFloats, path, entries[k]);
  std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(kFloats, share * hn::Abs(change) > floats(kSteep), bytes);
  for (unsigned bits = bytes[0] | bytes[1] << 8; bits != 0; bits &= bits - 1)
    if (const auto s = i + static_cast<std::size_t>(std::countr_zero(bits)); s < samples.size)
      refine_entry(table, samples, k, s);
}

/// Finds the opacity of each sample and its pieces. Labels are constant along an interval; a row of
/// the table is one label.
template <class S, bool kLabels>
HWY_INLINE void find_opacity(const RayGrid& grid, Samples<S>& samples) {
  const TransferTable& table = grid.table;
  const Floats zero = floats(0), one = floats(1.f);
  const Floats half = floats(0.5f), piece = floats(1.f / kPieces);
  const Ints last = ints(static_cast<std::int32_t>(table.entries) - 1);
  for (std::size_t i = 0; i < samples.size; i += kLanes) {
    // Lanes after the last sample hold anything: clamp, so that every access is in the table.
    const Ints end = ints(static_cast<std::int32_t>(table.integrals.size()) - 1);
    const Ints row = hn::Max(ints(0), hn::Min(load(samples.row + i), end));
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
    Ints entries[kPieces + 1];
    for (int k = 0; k <= kPieces; ++k) {
      Ints entry = ints(0);
      at[k] = zero;
      if constexpr (!kLabels) {
        Floats p[3];
        find_position(samples, floats(static_cast<float>(k) / kPieces), i, p);
        at[k] = table_position(table, value(p));
        entry = hn::Min(hn::Max(hn::ConvertTo(kInts, at[k]), entry), last);
      }
      within[k] = at[k] - hn::ConvertTo(kFloats, entry);
      store(at[k], samples.value[k] + i);
      entries[k] = hn::Min(entry + row, end);
    }
    // The integral of the extinction up to each of them.
    Floats before[kPieces + 1], extinction[kPieces + 1];
    for (int k = 0; k <= kPieces; ++k) {
      load_integrals(table, entries[k], before[k], extinction[k]);
      before[k] = hn::MulAdd(within[k], extinction[k], before[k]);
    }
    const Floats length = load(samples.length + i) * piece;
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
      const Floats ratio = hn::Min(mean / hn::Max(most, floats(1e-20f)), one);
      const Floats rising = hn::Max(hn::NegMulAdd(floats(2.f / 3), ratio, one),
                                    hn::NegMulAdd(floats(1.f / 3), ratio, floats(5.f / 6)));
      const Floats mass = hn::IfThenElse(extinction[k + 1] > extinction[k], rising, one - rising);
      const Floats extent = hn::Min(ratio + ratio, one);
      // The mean position at which light is absorbed, 1/d - 1/(exp(d) - 1), lies before that.
      const Floats d = hn::Min(depth, floats(8.f));
      const Floats before_middle = d * hn::MulAdd(d, floats(-0.0045f), floats(1.f / 12));
      const Floats middle = hn::NegMulAdd(extent, before_middle, mass);
      const Floats place = piece * (middle + floats(k));
      store(piece * extent * (half - before_middle), samples.reach[k] + i);
      store(share, samples.share[k] + i);
      store(place, samples.place[k] + i);
      center = hn::MulAdd(share, place, center);
      const Ints entry = hn::Min(hn::NearestInt(hn::MulAdd(middle, change, at[k])), last);
      store(row + hn::Max(entry, ints(0)), samples.entry[k] + i);
      // Few pieces reach so many entries that they may be steep.
      const Floats step = floats(1.001f * table.color_step);
      const auto may_be = share * hn::MulAdd(hn::Abs(change), step, step) > floats(kSteep);
      if (!kLabels && !hn::AllFalse(kFloats, may_be))
        refine_entries(table, samples, k, i, entries, share);
      left = after;
    }
    const Floats opacity = one - left;
    const Floats inverse = one / hn::Max(opacity, floats(1e-30f));
    store(opacity, samples.opacity + i);
    store(center * inverse, samples.center + i);
  }
}

/// Polynomials of a sample's position, 0 to 1 along its interval: a + t (b - a), where t goes from
/// `start` by `across`.
template <int N>
HWY_INLINE void mix(const Floats (&a)[N], const Floats (&b)[N], Floats start, Floats across,
                    Floats (&mixed)[N + 1]) {
  Floats step[N];
  for (int k = 0; k < N; ++k) {
    step[k] = b[k] - a[k];
    mixed[k] = hn::MulAdd(start, step[k], a[k]);
    if (k > 0) mixed[k] = hn::MulAdd(across, step[k - 1], mixed[k]);
  }
  mixed[N] = across * step[N - 1];
}

/// Exact division and root: approximations differ from machine to machine, and with them fields.
HWY_INLINE Floats inverse_sqrt(Floats x) { return floats(1.f) / hn::Sqrt(x); }

/// The normals of kLanes samples: against the gradient (world), and as long as that. The trilinear
/// interpolation of central differences has no facets; along an interval it is a cubic polynomial.
struct Normals {
  Floats along[3][4];

  HWY_INLINE void operator()(Floats u, Floats (&normal)[3]) const {
    for (int axis = 0; axis < 3; ++axis) {
      const Floats(&a)[4] = along[axis];
      normal[axis] = hn::MulAdd(u, hn::MulAdd(u, hn::MulAdd(u, a[3], a[2]), a[1]), a[0]);
    }
  }
};
template <class S>
HWY_INLINE Normals normals_of(const RayGrid& grid, const Samples<S>& samples, std::size_t i) {
  Columns row[12];
  for (int r = 0; r < 12; ++r) row[r] = load_columns(samples.rows[r] + i);
  Floats start[3], across[3], cubic[3][4];
  for (int axis = 0; axis < 3; ++axis) {
    start[axis] = load(samples.start[axis] + i);
    across[axis] = load(samples.across[axis] + i);
  }
  // At the corners, by (y, z).
  constexpr int kAbove[2][4] = {{1, 6, 3, 7}, {2, 3, 10, 11}};  // along y, z; see kRowY, kRowZ
  constexpr int kBelow[2][4] = {{4, 0, 5, 2}, {8, 9, 0, 1}};
  for (int axis = 0; axis < 3; ++axis) {
    Floats line[4][2], plane[2][3];
    for (int r = 0; r < 4; ++r) {
      Floats x0[1] = {row[r].x2 - row[r].x0}, x1[1] = {row[r].x3 - row[r].x1};
      if (axis > 0) {
        const Columns &above = row[kAbove[axis - 1][r]], &below = row[kBelow[axis - 1][r]];
        x0[0] = above.x1 - below.x1;
        x1[0] = above.x2 - below.x2;
      }
      mix(x0, x1, start[0], across[0], line[r]);
    }
    for (int z = 0; z < 2; ++z) mix(line[2 * z], line[2 * z + 1], start[1], across[1], plane[z]);
    mix(plane[0], plane[1], start[2], across[2], cubic[axis]);
  }
  // To world coordinates.
  Normals normals;
  const auto& m = grid.gradient_to_world;
  for (int axis = 0; axis < 3; ++axis)
    for (int k = 0; k < 4; ++k)
      normals.along[axis][k] = hn::MulAdd(floats(-0.5f * m[0][axis]), cubic[0][k],
                                          hn::MulAdd(floats(-0.5f * m[1][axis]), cubic[1][k],
                                                     floats(-0.5f * m[2][axis]) * cubic[2][k]));
  return normals;
}

/// The places of kLanes samples, in voxels, where their intervals have the position `u`.
template <class S>
HWY_INLINE void find_place(const Samples<S>& samples, Floats u, std::size_t i, Floats (&at)[3]) {
  find_position(samples, u, i, at);
  for (int axis = 0; axis < 3; ++axis)
    at[axis] = at[axis] + hn::ConvertTo(kFloats, load(samples.cell[axis] + i));
}

/// How far places lie below a plane that clips the volume, in voxels.
HWY_INLINE Floats below(const GridPlane& plane, const Floats (&at)[3]) {
  Floats sum = floats(plane.offset);
  for (int axis = 0; axis < 3; ++axis) sum = hn::MulAdd(floats(plane.inwards[axis]), at[axis], sum);
  return sum;
}

/// Turns normals (world, times the share of the surface) at places so far below a face towards it,
/// within a voxel: a face cuts matter, so there it is the surface.
HWY_INLINE void turn_to_face(Floats below, Floats sign, const glm::vec4& outwards,
                             Floats (&normal)[3]) {
  const Floats one = floats(1.f);
  const Floats share = hn::Max(floats(0), hn::Min(one, one - below));
  for (int k = 0; k < 3; ++k)
    normal[k] = hn::MulAdd(share * sign, floats(outwards[k]), normal[k] * (one - share));
}
HWY_INLINE void turn_to_clip(const RayGrid& grid, const Floats (&at)[3], Floats (&normal)[3]) {
  for (const GridPlane& plane : grid.clip)
    turn_to_face(below(plane, at), floats(1.f), plane.outwards, normal);
}

/// The part of normals towards the direct light, and their lengths squared, above 0.
HWY_INLINE void measure(const RayGrid& grid, const Floats (&normal)[3], Floats& toward,
                        Floats& length2) {
  toward = floats(0);
  length2 = floats(1e-30f);
  for (int axis = 0; axis < 3; ++axis) {
    toward = hn::MulAdd(normal[axis], floats(grid.light[axis]), toward);
    length2 = hn::MulAdd(normal[axis], normal[axis], length2);
  }
}

/// Multiplies the pieces' shares by ambient and Lambertian light at several places of each, because
/// normals change quickly below a surface.
template <class S>
HWY_INLINE void shade(const RayGrid& grid, Samples<S>& samples) {
  const Floats one = floats(1.f);
  for (std::size_t i = 0; i < samples.size; i += kLanes) {
    const Normals normals = normals_of(grid, samples, i);
    for (int k = 0; k < kPieces; ++k) {
      Floats light = floats(0);
      for (int point = 0; point < kPoints; ++point) {
        const float offset = (2 * static_cast<float>(point) + 1) / kPoints - 1;
        const Floats place =
            hn::MulAdd(floats(offset), load(samples.reach[k] + i), load(samples.place[k] + i));
        Floats normal[3], toward, length2;
        normals(place, normal);
        measure(grid, normal, toward, length2);
        // Small gradients are unreliable: fade their shading out.
        Floats inverse = inverse_sqrt(length2);
        Floats sure = hn::Min(one, length2 * inverse * floats(grid.inverse_gradient_floor));
        if (!grid.clip.empty()) {
          const auto finite = hn::IsFinite(length2);
          for (Floats& n : normal) n = hn::IfThenElseZero(finite, n * (sure * inverse));
          Floats at[3];
          find_place(samples, place, i, at);
          turn_to_clip(grid, at, normal);
          measure(grid, normal, toward, length2);
          inverse = inverse_sqrt(length2);
          sure = length2 * inverse;
        }
        const Floats lambert = hn::Max(floats(0), toward) * inverse;
        const Floats dark = floats(1 - grid.ambient) * (one - lambert);
        Floats shown = hn::NegMulAdd(dark, sure, one);
        if constexpr (std::is_same_v<S, float>)  // the square of a large one is not finite
          shown = hn::IfThenElse(hn::IsFinite(length2), shown, one);
        light = light + shown;
      }
      const Floats share = load(samples.share[k] + i);
      store(share * light * floats(1.f / kPoints), samples.share[k] + i);
    }
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#endif
