// The light of intervals under a light volume. Part of raycaster_kernel.cc.

// Included once per instruction set.
#if defined(SLF_FIELD_RAYCASTER_LIGHT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLF_FIELD_RAYCASTER_LIGHT_INL_H_
#undef SLF_FIELD_RAYCASTER_LIGHT_INL_H_
#else
#define SLF_FIELD_RAYCASTER_LIGHT_INL_H_
#endif

#include <hwy/highway.h>

#include "source/raycast/raycaster_samples-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

/// What arrives at kLanes places, given in nodes, trilinear between them: `found` has the channels
/// of an ArrivingLight. A node's bytes are the lanes of a vector, so each of a sample's eight nodes
/// is one load. Finds it for the first `count` lanes; those without opacity look up the first
/// nodes.
HWY_INLINE void look_up(const LightGrid& grid, const Floats (&at)[3], Floats opacity,
                        std::size_t count, Floats (&found)[kChannels + 1]) {
  const Ints zero = ints(0), one = ints(1);
  Floats share[3][2];
  Ints first = zero, step[3];
  for (int axis = 2; axis >= 0; --axis) {
    const Ints last = ints(grid.dims[axis] - 1);
    const Floats p = hn::IfThenElseZero(opacity > floats(0), hn::Max(floats(0), at[axis]));
    // Lanes after the last sample hold anything: clamp, so that every access is in the grid.
    const Ints cell = hn::Max(zero, hn::Min(hn::ConvertTo(kInts, p), last));
    share[axis][1] = hn::Min(p - hn::ConvertTo(kFloats, cell), floats(1.f));
    share[axis][0] = floats(1.f) - share[axis][1];
    step[axis] = hn::Min(one, last - cell);  // 0 in the last node of an axis
    first = first * ints(grid.dims[axis]) + cell;
  }
  step[1] = step[1] * ints(grid.dims[0]);
  step[2] = step[2] * ints(grid.dims[0] * grid.dims[1]);
  alignas(64) std::int32_t nodes[8][kLanes];
  alignas(64) float weights[8][kLanes];
  for (int corner = 0; corner < 8; ++corner) {
    const int x = corner & 1, y = corner >> 1 & 1, z = corner >> 2;
    Ints node = first;
    if (x) node = node + step[0];
    if (y) node = node + step[1];
    if (z) node = node + step[2];
    store(node, nodes[corner]);
    store(share[0][x] * share[1][y] * share[2][z], weights[corner]);
  }
  const hn::CappedTag<float, 16> channels;
  const hn::Rebind<std::uint8_t, decltype(channels)> bytes;
  const hn::Rebind<std::int32_t, decltype(channels)> ints;
  constexpr std::size_t kStep = hn::MaxLanes(hn::CappedTag<float, 16>());
  constexpr std::size_t kVectors = (LightGrid::kNodeBytes + kStep - 1) / kStep;
  static_assert(kVectors * kStep <= LightGrid::kNodeBytes + LightGrid::kPadding);
  alignas(64) glm::vec4 blocks[3][kLanes] = {};  // of four channels
  for (std::size_t lane = 0; lane < count; ++lane) {
    hn::Vec<decltype(channels)> sum[kVectors];
    for (auto& v : sum) v = hn::Zero(channels);
    for (int corner = 0; corner < 8; ++corner) {
      const std::uint8_t* node = grid.node(static_cast<std::size_t>(nodes[corner][lane]));
      if (HWY_UNLIKELY(node[kChannels] == kMissingNode))
        grid.missed->add(static_cast<std::size_t>(nodes[corner][lane]));
      const NodeUnits& units = kNodeUnits[node[kChannels]];
      const auto weight = hn::Set(channels, weights[corner][lane]);
      for (std::size_t v = 0; v < kVectors; ++v) {
        const auto steps = hn::PromoteTo(ints, hn::LoadU(bytes, node + v * kStep)) -
                           hn::Load(ints, &kNodeZeros[v * kStep]);
        sum[v] = hn::MulAdd(weight * hn::Load(channels, &units[v * kStep]),
                            hn::ConvertTo(channels, steps), sum[v]);
      }
    }
    alignas(64) float one_sample[16];
    for (std::size_t v = 0; v < kVectors; ++v) hn::Store(sum[v], channels, one_sample + v * kStep);
    for (std::size_t block = 0; block < 3; ++block)
      std::memcpy(&blocks[block][lane], one_sample + 4 * block, sizeof blocks[block][lane]);
  }
  for (std::size_t block = 0; block < 3; ++block)
    hn::LoadInterleaved4(kFloats, &blocks[block][0].x, found[4 * block], found[4 * block + 1],
                         found[4 * block + 2], found[4 * block + 3]);
}

/// Finds the normals of kLanes samples, as Medium::matter does.
template <class S>
struct NormalFinder {
  const RayGrid& grid;
  const Samples<S>& samples;
  std::size_t i;
  Normals normals = normals_of(grid, samples, i);
  bool cut = near_face();

  HWY_INLINE bool near_face() const {
    auto at_face = ints(0) > ints(0);
    for (int axis = 0; axis < 3; ++axis) {
      const Ints cell = load(samples.cell[axis] + i);
      at_face = hn::Or(at_face, hn::Or(cell == ints(0), cell == ints(grid.dims[axis] - 2)));
    }
    for (int end = 0; end < (grid.clip.empty() ? 0 : 2); ++end) {
      Floats at[3];
      find_place(samples, floats(end), i, at);
      for (const GridPlane& plane : grid.clip)
        at_face = hn::Or(at_face, hn::RebindMask(kInts, below(plane, at) < floats(1.f)));
    }
    return !hn::AllFalse(kInts, at_face);
  }

  /// The normal (world) at a place of the interval, times how far it is a surface if it is opaque.
  HWY_INLINE void operator()(Floats place, Floats (&normal)[3]) const {
    Floats length2 = floats(1e-30f);
    normals(place, normal);
    for (const Floats& n : normal) length2 = hn::MulAdd(n, n, length2);
    const Floats one = floats(1.f), inverse = inverse_sqrt(length2);
    const Floats sure =
        one - hn::Exp(kFloats, length2 * inverse * floats(-grid.inverse_gradient_floor));
    const auto finite = hn::IsFinite(length2);  // not the square of a gradient above 1.8e19
    for (Floats& n : normal) n = hn::IfThenElseZero(finite, n * (sure * inverse));
    if (!cut) return;
    Floats at[3];
    find_place(samples, place, i, at);
    for (int axis = 0; axis < 3; ++axis) {
      const Floats high = floats(grid.dims[axis] - 1) - at[axis];
      turn_to_face(hn::Min(at[axis], high), hn::IfThenElse(at[axis] < high, hn::Neg(one), one),
                   grid.face_normals[axis], normal);
    }
    turn_to_clip(grid, at, normal);
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
    in.direction[k] = floats(light.direction[k]);
    in.rgb[k] = floats(light.irradiance[k]);
  }
  if (light.distance == 0) return in;
  // As PlacedLight::incident_light().
  Floats length2 = floats(1e-30f), cosine = floats(0);
  for (int k = 0; k < 3; ++k) {
    Floats to = floats(light.place[k]);
    for (int axis = 0; axis < 3; ++axis)
      to = hn::NegMulAdd(floats(grid.index_to_world[axis][k]), at[axis], to);
    cosine = hn::MulAdd(to, in.direction[k], cosine);
    length2 = hn::MulAdd(to, to, length2);
    in.direction[k] = to;
  }
  const Floats inverse = inverse_sqrt(length2);
  const Floats ratio = floats(light.distance) * inverse;
  const Floats falls = hn::Max(cosine, floats(0)) * inverse * ratio * ratio;
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
  const LightGrid& light = *grid.light_volume;
  const Floats zero = floats(0), one = floats(1.f);
  const Ints last = ints(static_cast<std::int32_t>(grid.table.albedos.size()) - 1);
  for (std::size_t i = 0; i < samples.size; i += kLanes) {
    const NormalFinder<S> normal_at{grid, samples, i};
    Floats share[kPieces], normal[kPieces][3], surface[kPieces];
    Floats total = floats(1e-20f), mean_surface = zero, mean[3] = {zero, zero, zero};
    for (int k = 0; k < kPieces; ++k) {
      const Ints entry = hn::Max(ints(0), hn::Min(load(samples.entry[k] + i), last));
      const Floats dense =
          hn::GatherIndex(kFloats, &grid.table.albedos[0].w, hn::ShiftLeft<2>(entry));
      normal_at(load(samples.place[k] + i), normal[k]);
      Floats size2 = zero;
      for (Floats& n : normal[k]) {
        n = n * dense;
        size2 = hn::MulAdd(n, n, size2);
      }
      surface[k] = hn::Sqrt(size2);
      share[k] = load(samples.share[k] + i);
      total = total + share[k];
      mean_surface = hn::MulAdd(share[k], surface[k], mean_surface);
      for (int axis = 0; axis < 3; ++axis)
        mean[axis] = hn::MulAdd(share[k], normal[k][axis], mean[axis]);
    }
    // The place of the look-up, as LightSolver::look_up_place().
    Floats at[3], nodes[3], aside[3], length2 = floats(1e-12f);
    for (int axis = 0; axis < 3; ++axis) {
      aside[axis] = zero;
      for (int k = 0; k < 3; ++k)
        aside[axis] = hn::MulAdd(floats(grid.world_to_index[k][axis]), mean[k], aside[axis]);
      length2 = hn::MulAdd(aside[axis], aside[axis], length2);
    }
    const Floats beside = floats(kLookUpBeside) * mean_surface / (total * hn::Sqrt(length2));
    find_place(samples, load(samples.center + i), i, at);
    for (int axis = 0; axis < 3; ++axis) {
      nodes[axis] = hn::MulAdd(at[axis] - floats(light.low[axis]), floats(1 / light.spacing),
                               beside * aside[axis]);
    }
    Floats found[kChannels + 1];
    look_up(light, nodes, load(samples.opacity + i), std::min(kLanes, samples.size - i), found);
    // Green, from a luminance of 1.
    const Floats green = hn::NegMulAdd(
        floats(kLuminance.r / kLuminance.g), found[9],
        hn::NegMulAdd(floats(kLuminance.b / kLuminance.g), found[10], floats(1 / kLuminance.g)));
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
            hn::MulAdd(hn::Max(toward, zero), floats(std::numbers::inv_pi_v<float>),
                       (one - surface[k]) * floats(std::numbers::inv_pi_v<float> / 4));
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
