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
  // With a light volume: RGB light at a piece times its share, and how much of it is a surface.
  alignas(64) glm::vec4 light[kPieces][kMaxSamples];
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

/// Twice the central differences of kLanes samples, trilinear in their cells.
struct Gradient {
  Trilinear along[3];
};
template <class S>
HWY_INLINE Gradient gradient_of(const Samples<S>& samples, std::size_t i) {
  Columns row[12];
  for (int r = 0; r < 12; ++r) row[r] = load_columns(samples.rows[r] + i);
  // At the corners, by (y, z).
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
  return {{trilinear(x0[0], x1[0]), trilinear(x0[1], x1[1]), trilinear(x0[2], x1[2])}};
}

/// The faces of the volume, and the planes that clip it: they cut matter, so there they are its
/// surface.
template <class S>
struct Faces {
  const RayGrid& grid;
  const Samples<S>& samples;
  std::size_t i;
  bool near = any_near();  ///< one of kLanes samples, at least

  HWY_INLINE void find_place(Floats u, Floats (&at)[3]) const {
    find_position(samples, u, i, at);
    for (int axis = 0; axis < 3; ++axis)
      at[axis] = at[axis] + hn::ConvertTo(kFloats, hn::Load(kInts, samples.cell[axis] + i));
  }
  /// How far places lie below a plane, in voxels.
  static HWY_INLINE Floats below(const GridPlane& plane, const Floats (&at)[3]) {
    Floats sum = hn::Set(kFloats, static_cast<float>(plane.offset));
    for (int axis = 0; axis < 3; ++axis)
      sum = hn::MulAdd(hn::Set(kFloats, static_cast<float>(plane.inwards[axis])), at[axis], sum);
    return sum;
  }
  HWY_INLINE bool any_near() const {
    auto at_face = hn::Zero(kInts) > hn::Zero(kInts);
    for (int axis = 0; axis < 3; ++axis) {
      const Ints cell = hn::Load(kInts, samples.cell[axis] + i);
      at_face = hn::Or(
          at_face, hn::Or(cell == hn::Zero(kInts), cell == hn::Set(kInts, grid.dims[axis] - 2)));
    }
    for (int end = 0; end < (grid.clip.empty() ? 0 : 2); ++end) {
      Floats at[3];
      find_place(hn::Set(kFloats, static_cast<float>(end)), at);
      for (const GridPlane& plane : grid.clip)
        at_face = hn::Or(at_face, hn::RebindMask(kInts, below(plane, at) < hn::Set(kFloats, 1.f)));
    }
    return !hn::AllFalse(kInts, at_face);
  }
  /// Turns the normals (world, times the share of the surface) at a place of the interval to those
  /// of faces within a voxel.
  HWY_INLINE void operator()(Floats place, Floats (&normal)[3]) const {
    const Floats one = hn::Set(kFloats, 1.f);
    Floats at[3];
    find_place(place, at);
    for (int axis = 0; axis < 3; ++axis) {
      const Floats high = hn::Set(kFloats, static_cast<float>(grid.dims[axis] - 1)) - at[axis];
      turn(hn::Min(at[axis], high), hn::IfThenElse(at[axis] < high, hn::Neg(one), one),
           grid.face_normals[axis], normal);
    }
    turn_to_clip(at, normal);
  }
  HWY_INLINE void turn_to_clip(const Floats (&at)[3], Floats (&normal)[3]) const {
    for (const GridPlane& plane : grid.clip)
      turn(below(plane, at), hn::Set(kFloats, 1.f), plane.outwards, normal);
  }
  static HWY_INLINE void turn(Floats below, Floats sign, const glm::vec4& to, Floats (&normal)[3]) {
    const Floats one = hn::Set(kFloats, 1.f);
    const Floats share = hn::Max(hn::Zero(kFloats), hn::Min(one, one - below));
    for (int k = 0; k < 3; ++k)
      normal[k] = hn::MulAdd(share * sign, hn::Set(kFloats, to[k]), normal[k] * (one - share));
  }
};

/// Multiplies the pieces' shares by ambient and Lambertian light at several places of each, because
/// normals change quickly below a surface. The normal is the trilinear interpolation of central
/// differences, so it has no facets.
template <class S>
HWY_INLINE void shade(const RayGrid& grid, Samples<S>& samples) {
  const Floats one = hn::Set(kFloats, 1.f);
  for (std::size_t i = 0; i < samples.size; i += kLanes) {
    const Gradient gradient = gradient_of(samples, i);
    const Faces<S> faces{grid, samples, i};
    Floats light[kPieces];
    for (int point = 0; point < kPieces * kPoints; ++point) {
      const int k = point / kPoints;
      const float offset = (2 * static_cast<float>(point % kPoints) + 1) / kPoints - 1;
      const Floats place =
          hn::MulAdd(hn::Set(kFloats, offset), hn::Load(kFloats, samples.reach[k] + i),
                     hn::Load(kFloats, samples.place[k] + i));
      Floats p[3];
      find_position(samples, place, i, p);
      const Floats d[3] = {gradient.along[0](p), gradient.along[1](p), gradient.along[2](p)};
      // Transform the gradient to world coordinates.
      const auto& m = grid.gradient_to_world;
      Floats toward = hn::Zero(kFloats), length2 = hn::Set(kFloats, 1e-30f), normal[3];
      for (int axis = 0; axis < 3; ++axis) {
        const Floats n = hn::MulAdd(hn::Set(kFloats, 0.5f * m[0][axis]), d[0],
                                    hn::MulAdd(hn::Set(kFloats, 0.5f * m[1][axis]), d[1],
                                               hn::Set(kFloats, 0.5f * m[2][axis]) * d[2]));
        toward = hn::NegMulAdd(n, hn::Set(kFloats, grid.light[axis]), toward);
        length2 = hn::MulAdd(n, n, length2);
        normal[axis] = hn::Neg(n);
      }
      // Small gradients are unreliable: fade their shading out.
      Floats length = hn::Sqrt(length2);
      Floats sure = hn::Min(one, length * hn::Set(kFloats, grid.inverse_gradient_floor));
      if (!grid.clip.empty()) {
        for (Floats& n : normal) n = n * (sure / length);
        Floats at[3];
        faces.find_place(place, at);
        faces.turn_to_clip(at, normal);
        toward = hn::Zero(kFloats);
        length2 = hn::Set(kFloats, 1e-30f);
        for (int axis = 0; axis < 3; ++axis) {
          toward = hn::MulAdd(normal[axis], hn::Set(kFloats, grid.light[axis]), toward);
          length2 = hn::MulAdd(normal[axis], normal[axis], length2);
        }
        sure = length = hn::Sqrt(length2);
      }
      const Floats lambert = hn::Max(hn::Zero(kFloats), toward) / length;
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

/// What arrives at kLanes places, given in nodes, trilinear between them: `found` has the channels
/// of an ArrivingLight. A node's bytes are the lanes of a vector, so each of a sample's eight nodes
/// is one load. Finds it for the first `count` lanes, where `opacity` is above 0.
HWY_INLINE void look_up(const LightGrid& grid, const Floats (&at)[3], const float* opacity,
                        std::size_t count, Floats (&found)[kChannels]) {
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
  alignas(64) std::int32_t nodes[8][kLanes];
  alignas(64) float weights[8][kLanes];
  for (int corner = 0; corner < 8; ++corner) {
    const int x = corner & 1, y = corner >> 1 & 1, z = corner >> 2;
    Ints node = first;
    if (x) node = node + step[0];
    if (y) node = node + step[1];
    if (z) node = node + step[2];
    hn::Store(node, kInts, nodes[corner]);
    hn::Store(share[0][x] * share[1][y] * share[2][z], kFloats, weights[corner]);
  }
  const hn::CappedTag<float, 16> channels;
  const hn::Rebind<std::uint8_t, decltype(channels)> bytes;
  const hn::Rebind<std::int32_t, decltype(channels)> ints;
  constexpr std::size_t kStep = hn::MaxLanes(hn::CappedTag<float, 16>());
  constexpr std::size_t kVectors = (kChannels + kStep - 1) / kStep;
  static_assert(kVectors * kStep <= LightGrid::kNodeBytes + LightGrid::kPadding);
  alignas(64) float values[kChannels][kLanes] = {};
  for (std::size_t lane = 0; lane < count; ++lane) {
    if (!(opacity[lane] > 0)) continue;
    hn::Vec<decltype(channels)> sum[kVectors];
    for (auto& v : sum) v = hn::Zero(channels);
    for (int corner = 0; corner < 8; ++corner) {
      const std::uint8_t* node =
          grid.nodes.data() + LightGrid::kNodeBytes * static_cast<std::size_t>(nodes[corner][lane]);
      const NodeUnits& units = kNodeUnits[node[kChannels]];
      const auto weight = hn::Set(channels, weights[corner][lane]);
      for (std::size_t v = 0; v < kVectors; ++v) {
        const auto byte =
            hn::ConvertTo(channels, hn::PromoteTo(ints, hn::LoadU(bytes, node + v * kStep)));
        const auto value = hn::MulAdd(byte, hn::Load(channels, &units.unit[v * kStep]),
                                      hn::Load(channels, &units.offset[v * kStep]));
        sum[v] = hn::MulAdd(weight, value, sum[v]);
      }
    }
    alignas(64) float one_sample[kVectors * kStep];
    for (std::size_t v = 0; v < kVectors; ++v) hn::Store(sum[v], channels, one_sample + v * kStep);
    for (int c = 0; c < kChannels; ++c) values[c][lane] = one_sample[c];
  }
  for (int c = 0; c < kChannels; ++c) found[c] = hn::Load(kFloats, values[c]);
}

/// Finds the normals of kLanes samples, as Medium::matter does.
template <class S>
struct NormalFinder {
  const RayGrid& grid;
  const Samples<S>& samples;
  std::size_t i;
  Gradient gradient = gradient_of(samples, i);
  Faces<S> faces{grid, samples, i};

  /// The normal (world) at a place of the interval, times how far it is a surface if it is opaque.
  HWY_INLINE void operator()(Floats place, Floats (&normal)[3]) const {
    Floats p[3], length2 = hn::Set(kFloats, 1e-30f);
    find_position(samples, place, i, p);
    const Floats d[3] = {gradient.along[0](p), gradient.along[1](p), gradient.along[2](p)};
    const auto& m = grid.gradient_to_world;
    for (int axis = 0; axis < 3; ++axis) {
      normal[axis] = hn::MulAdd(hn::Set(kFloats, -0.5f * m[0][axis]), d[0],
                                hn::MulAdd(hn::Set(kFloats, -0.5f * m[1][axis]), d[1],
                                           hn::Set(kFloats, -0.5f * m[2][axis]) * d[2]));
      length2 = hn::MulAdd(normal[axis], normal[axis], length2);
    }
    const Floats one = hn::Set(kFloats, 1.f), length = hn::Sqrt(length2);
    const Floats sure =
        one - hn::Exp(kFloats, length * hn::Set(kFloats, -grid.inverse_gradient_floor));
    const Floats scale = hn::IfThenElseZero(hn::IsFinite(length2), sure / length);
    for (Floats& n : normal) n = n * scale;
    if (faces.near) faces(place, normal);
  }
};

/// The light of one of the grid's lights, if nothing is in the way: its direction and irradiance,
/// by the places of kLanes samples in voxels.
struct Incidence {
  Floats direction[3], rgb[3];
};
HWY_INLINE Incidence incidence(const RayGrid& grid, const GridLight& light, const Floats (&at)[3]) {
  Incidence in;
  for (int k = 0; k < 3; ++k) {
    in.direction[k] = hn::Set(kFloats, light.direction[k]);
    in.rgb[k] = hn::Set(kFloats, light.irradiance[k]);
  }
  if (light.distance == 0) return in;
  // As PlacedLight::incident_light().
  Floats length2 = hn::Set(kFloats, 1e-30f), cosine = hn::Zero(kFloats);
  for (int k = 0; k < 3; ++k) {
    Floats to = hn::Set(kFloats, light.place[k]);
    for (int axis = 0; axis < 3; ++axis)
      to = hn::NegMulAdd(hn::Set(kFloats, grid.index_to_world[axis][k]), at[axis], to);
    cosine = hn::MulAdd(to, in.direction[k], cosine);
    length2 = hn::MulAdd(to, to, length2);
    in.direction[k] = to;
  }
  const Floats inverse = hn::Set(kFloats, 1.f) / hn::Sqrt(length2);
  const Floats ratio = hn::Set(kFloats, light.distance) * inverse;
  const Floats falls = hn::Max(cosine, hn::Zero(kFloats)) * inverse * ratio * ratio;
  for (int k = 0; k < 3; ++k) {
    in.direction[k] = in.direction[k] * inverse;
    in.rgb[k] = in.rgb[k] * falls;
  }
  return in;
}

/// Finds the light at each piece. What arrives is looked up once per sample, at its middle, beside
/// the matter; normals and surfaces are found for each piece, since they change within a voxel.
template <class S>
HWY_INLINE void find_light(const RayGrid& grid, Samples<S>& samples) {
  const LightGrid& light = grid.light_volume;
  const Floats zero = hn::Zero(kFloats), one = hn::Set(kFloats, 1.f);
  const Ints last = hn::Set(kInts, static_cast<std::int32_t>(grid.table.albedos.size()) - 1);
  for (std::size_t i = 0; i < samples.size; i += kLanes) {
    const NormalFinder<S> normal_at{grid, samples, i};
    Floats share[kPieces], normal[kPieces][3], surface[kPieces];
    Floats total = hn::Set(kFloats, 1e-20f), mean_surface = zero, mean[3] = {zero, zero, zero};
    for (int k = 0; k < kPieces; ++k) {
      const Ints entry =
          hn::Max(hn::Zero(kInts), hn::Min(hn::Load(kInts, samples.entry[k] + i), last));
      const Floats dense =
          hn::GatherIndex(kFloats, &grid.table.albedos[0].w, hn::ShiftLeft<2>(entry));
      normal_at(hn::Load(kFloats, samples.place[k] + i), normal[k]);
      Floats size2 = zero;
      for (Floats& n : normal[k]) {
        n = n * dense;
        size2 = hn::MulAdd(n, n, size2);
      }
      surface[k] = hn::Sqrt(size2);
      share[k] = hn::Load(kFloats, samples.share[k] + i);
      total = total + share[k];
      mean_surface = hn::MulAdd(share[k], surface[k], mean_surface);
      for (int axis = 0; axis < 3; ++axis)
        mean[axis] = hn::MulAdd(share[k], normal[k][axis], mean[axis]);
    }
    // The place of the look-up, as LightSolver::look_up_place().
    Floats at[3], nodes[3], aside[3], length2 = hn::Set(kFloats, 1e-12f);
    for (int axis = 0; axis < 3; ++axis) {
      aside[axis] = zero;
      for (int k = 0; k < 3; ++k)
        aside[axis] = hn::MulAdd(hn::Set(kFloats, static_cast<float>(grid.world_to_index[k][axis])),
                                 mean[k], aside[axis]);
      length2 = hn::MulAdd(aside[axis], aside[axis], length2);
    }
    const Floats beside =
        hn::Set(kFloats, kLookUpBeside) * mean_surface / (total * hn::Sqrt(length2));
    find_position(samples, hn::Load(kFloats, samples.center + i), i, at);
    for (int axis = 0; axis < 3; ++axis) {
      at[axis] = at[axis] + hn::ConvertTo(kFloats, hn::Load(kInts, samples.cell[axis] + i));
      nodes[axis] =
          hn::MulAdd(at[axis] - hn::Set(kFloats, static_cast<float>(light.low[axis])),
                     hn::Set(kFloats, static_cast<float>(1 / light.spacing)), beside * aside[axis]);
    }
    Floats found[kChannels];
    look_up(light, nodes, samples.opacity + i, std::min(kLanes, samples.size - i), found);
    // Green, from a luminance of 1.
    const Floats green =
        hn::NegMulAdd(hn::Set(kFloats, kLuminance.r / kLuminance.g), found[9],
                      hn::NegMulAdd(hn::Set(kFloats, kLuminance.b / kLuminance.g), found[10],
                                    hn::Set(kFloats, 1 / kLuminance.g)));
    const Floats tint[3] = {found[9], green, found[10]};
    Floats rgb[kPieces][3];
    for (int k = 0; k < kPieces; ++k) {
      const Floats change = hn::MulAdd(found[3], normal[k][0],
                                       hn::MulAdd(found[4], normal[k][1], found[5] * normal[k][2]));
      for (int c = 0; c < 3; ++c) rgb[k][c] = hn::Max(zero, hn::MulAdd(change, tint[c], found[c]));
    }
    for (std::size_t l = 0; l < light.lights.size(); ++l) {
      const Incidence in = incidence(grid, light.lights[l], at);
      for (int k = 0; k < kPieces; ++k) {
        const Floats toward =
            hn::MulAdd(in.direction[0], normal[k][0],
                       hn::MulAdd(in.direction[1], normal[k][1], in.direction[2] * normal[k][2]));
        // Matter::kernel().
        const Floats kernel =
            hn::MulAdd(hn::Max(toward, zero), hn::Set(kFloats, std::numbers::inv_pi_v<float>),
                       (one - surface[k]) * hn::Set(kFloats, std::numbers::inv_pi_v<float> / 4));
        const Floats arrives = kernel * found[6 + l];
        for (int c = 0; c < 3; ++c) rgb[k][c] = hn::MulAdd(arrives, in.rgb[c], rgb[k][c]);
      }
    }
    for (int k = 0; k < kPieces; ++k)
      hn::StoreInterleaved4(rgb[k][0] * share[k], rgb[k][1] * share[k], rgb[k][2] * share[k],
                            surface[k], kFloats, &samples.light[k][i].x);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#endif
