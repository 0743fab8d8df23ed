#include "field/render/blend_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/render/blend_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include "field/render/blend_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

/// Rays and samples below this opacity have no depth.
constexpr float kFaintOpacity = 1.f / 255;
/// The share of the round before in pixels that are a mean: aims often swing about their goal.
constexpr float kShareBefore = 0.4f;

/// Whether all samples of a vector of rays, from `k` on, are 0. This is frequent.
template <bool kHalf>
HWY_INLINE bool all_zero(const Pass& pass, const BlockSamples& samples, std::size_t k) {
  const DU d;
  VU any = hn::Zero(d);
  for (std::size_t slot = 0; slot < 3 * pass.entries; ++slot) {
    const auto* words = reinterpret_cast<const std::uint32_t*>(&colors_of<kHalf>(samples)[slot][k]);
    for (std::size_t word = 0; word < (kHalf ? 2 : 1); ++word)
      any = hn::Or(any, hn::LoadU(d, words + word * hn::Lanes(d)));
  }
  return hn::AllTrue(d, hn::Eq(any, hn::Zero(d)));
}

/// The colours of the rays from `k` on by the interpolation weights alone (eq. 2).
template <bool kHalf>
HWY_INLINE Colors interpolate(const Pass& pass, const EntryCells& entries,
                              const BlockSamples& samples, std::size_t k) {
  const D d;
  Colors sum = Colors::none();
  if (all_zero<kHalf>(pass, samples, k)) return sum;
  for (std::size_t c = 0; c < pass.entries; ++c) {
    const V weight = hn::LoadU(d, &entries.weight[c][k]);
    for (std::size_t e = 0; e < 3; ++e)
      sum = sum.plus(hn::Mul(weight, hn::LoadU(d, &pass.exit[c]->weight[e][k])),
                     load_colors(colors_of<kHalf>(samples)[3 * c + e], k));
  }
  return sum.times(hn::Set(d, 1 / kFullScale<kHalf>));
}

template <bool kHalf>
void blend_color(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
                 const BlockSamples& samples, glm::vec4* picture) {
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(D()))
    store_pixels(interpolate<kHalf>(pass, entries, samples, k), rays, k, picture);
}

template <bool kHalf, bool kRefine>
void blend_with_depth(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
                      const BlockSamples& samples, glm::vec4* picture, DepthEstimates& estimates) {
  const D d;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f),
          faint = hn::Set(d, kFaintOpacity * kFullScale<kHalf>);
  const auto mean = [&](V of, V weight) {  // in 0..1 even if half floats are infinite or NaN
    const V at = hn::Div(of, weight);
    return hn::IfThenElseZero(hn::Gt(at, zero), hn::Min(at, one));
  };
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    if (!kRefine && all_zero<kHalf>(pass, samples, k)) {
      for (auto* array : {&estimates.t, &estimates.step, &estimates.contrast})
        store(zero, *array, k);
      store_pixels(Colors::none(), rays, k, picture);
      continue;
    }
    Colors sum = Colors::none();
    ColorRange range = ColorRange::of(load_colors(colors_of<kHalf>(samples)[0], k));
    V total = zero;  // sum of the weights
    V opacity = zero,
      place = zero;             // sums of opacity, and of opacity times depth along the ray
    V opacities[3], places[3];  // the same, by entry vertex
    const Chords chords(rays, k);
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const V weight = hn::LoadU(d, &entries.weight[c][k]);
      const Places at(pass, entries, samples, chords, c, k);
      const Agreement<kHalf> agreement(pass, at, estimates.aim[c], k);
      V opacity_c = zero, depth = zero;
      for (std::size_t e = 0; e < 3; ++e) {
        const V share = hn::Mul(weight, hn::LoadU(d, &pass.exit[c]->weight[e][k]));
        const Colors v = load_colors(colors_of<kHalf>(samples)[3 * c + e], k);
        const V visible = hn::Mul(share, v.a);
        opacity_c = hn::Add(opacity_c, visible);
        depth = hn::MulAdd(visible, at.depth[e], depth);
        if constexpr (kRefine) {
          const V w = agreement.of(share, at.depth[e], v.a);
          total = hn::Add(total, w);
          sum = sum.plus(w, v);
          range.add(ColorRange::of(v));
        }
      }
      opacities[c] = opacity_c;
      places[c] = hn::MulAdd(opacity_c, at.begin, hn::Mul(depth, at.scale));
      opacity = hn::Add(opacity, opacity_c);
      place = hn::Add(place, places[c]);
    }
    const auto enough = hn::Gt(opacity, faint);
    V ray_depth = mean(place, opacity);
    V step = zero;
    if constexpr (kRefine) {
      ray_depth = hn::IfThenElse(enough, ray_depth, hn::LoadU(d, &estimates.t[k]));
      for (std::size_t c = 0; c < 3; ++c) {
        const V weight = hn::LoadU(d, &entries.weight[c][k]);
        const auto visible = hn::Gt(opacities[c], hn::Mul(weight, faint));
        const V vertex_depth = hn::IfThenElse(visible, mean(places[c], opacities[c]), ray_depth);
        const V next = hn::Mul(hn::Add(ray_depth, vertex_depth), hn::Set(d, 0.5f));
        const V moved = hn::AbsDiff(next, hn::LoadU(d, &estimates.aim[c][k]));
        step = hn::Max(step, hn::IfThenElseZero(hn::Gt(weight, zero), moved));
        store(next, estimates.next[c], k);
      }
      store(hn::Mul(range.contrast(), hn::Set(d, 1 / kFullScale<kHalf>)), estimates.contrast, k);
    } else {
      ray_depth = hn::IfThenElseZero(hn::Gt(opacity, zero), ray_depth);
      step = hn::IfThenElseZero(enough, hn::Inf(d));
      for (std::size_t c = 0; c < 3; ++c) store(ray_depth, estimates.next[c], k);
      store(zero, estimates.contrast, k);
    }
    store(step, estimates.step, k);
    store(ray_depth, estimates.t, k);
    if constexpr (kRefine) {
      Colors pixels = sum.times(hn::Div(hn::Set(d, 1 / kFullScale<kHalf>), total));
      const auto means = hn::Gt(step, hn::Set(d, pass.mean_above));
      if (!hn::AllFalse(d, means)) {
        const V share = hn::IfThenElseZero(means, hn::Set(d, kShareBefore));
        pixels = pixels.plus(share, load_pixels(rays, k, picture).minus(pixels));
      }
      store_pixels(pixels, rays, k, picture);
    } else if (!pass.first_of_more || !hn::AllTrue(d, enough))
      store_pixels(interpolate<kHalf>(pass, entries, samples, k), rays, k, picture);
  }
}

template <bool kHalf>
void blend_typed(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
                 const BlockSamples& samples, glm::vec4* picture, DepthEstimates& estimates) {
  if (!pass.with_depth)
    blend_color<kHalf>(pass, rays, entries, samples, picture);
  else if (pass.depth_tolerance > 0)
    blend_with_depth<kHalf, true>(pass, rays, entries, samples, picture, estimates);
  else
    blend_with_depth<kHalf, false>(pass, rays, entries, samples, picture, estimates);
}

void blend_any(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
               const BlockSamples& samples, bool half_floats, glm::vec4* picture,
               DepthEstimates& estimates) {
  (half_floats ? blend_typed<true> : blend_typed<false>)(pass, rays, entries, samples, picture,
                                                         estimates);
}

/// How much of a cubic's curvature is used: more than all of it, because means of rays, and limits,
/// flatten curves.
constexpr float kCurvature = 1.25f;

template <bool kHalf>
HWY_INLINE const auto& next_colors_of(const BlockSamples& samples) {
  if constexpr (kHalf)
    return samples.next_rgba16f;
  else
    return samples.next_rgba8;
}

/// The colours of an entry vertex's rays from `k` on, between the three samples `v` with weights
/// `w`: what a cubic through the next samples on the lines through each two of them, limited to
/// the range of the three, differs from linear interpolation.
template <bool kHalf>
HWY_INLINE Colors bend(const Colors v[3], const V w[3], const ExitCells& exit,
                       const BlockSamples& samples, std::size_t c, std::size_t k) {
  const D d;
  const V one = hn::Set(d, 1.f), two = hn::Set(d, 2.f), three = hn::Set(d, 3.f);
  const auto& next = next_colors_of<kHalf>(samples);
  const auto exists = [&](std::size_t pair) {
    const VU column = hn::LoadU(DU(), &exit.next[pair][k]);
    return hn::RebindMask(d, hn::Ne(column, hn::Set(DU(), kOutside)));
  };
  Colors curve = Colors::none();
  for (std::size_t pair = 0; pair < 6; pair += 2) {
    const auto [i, j] = kVertexPairs[pair];
    const auto at_i = exists(pair), at_j = exists(pair + 1);
    const V product = hn::Mul(hn::Mul(w[i], w[j]), hn::Set(d, -kCurvature / 6));
    const V sum = hn::Add(w[i], w[j]);
    const V share = hn::IfThenElseZero(hn::Gt(sum, hn::Zero(d)), hn::Div(w[i], sum));
    // The second differences at i and at j count by how near they are, one alone for both.
    const V di = hn::IfThenElse(at_j, hn::Add(one, share), three);
    const V dj = hn::IfThenElse(at_i, hn::Sub(two, share), three);
    const V fi = hn::IfThenElseZero(at_i, hn::Mul(product, di));
    const V fj = hn::IfThenElseZero(at_j, hn::Mul(product, dj));
    curve = curve.plus(fi, load_colors(next[6 * c + pair], k))
                .plus(hn::NegMulAdd(two, fi, fj), v[i])
                .plus(hn::NegMulAdd(two, fj, fi), v[j])
                .plus(fj, load_colors(next[6 * c + pair + 1], k));
  }
  const Colors linear = v[0].times(w[0]).plus(w[1], v[1]).plus(w[2], v[2]);
  ColorRange range = ColorRange::of(v[0]);
  range.add(ColorRange::of(v[1])), range.add(ColorRange::of(v[2]));
  return range.clamp(linear.plus(one, curve)).minus(linear);
}

template <bool kHalf>
void add_cubic_typed(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
                     const BlockSamples& samples, const DepthEstimates& estimates,
                     glm::vec4* picture) {
  const D d;
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const Chords chords(rays, k);
    const Colors pixels = load_pixels(rays, k, picture).times(hn::Set(d, kFullScale<kHalf>));
    ColorRange range = ColorRange::of(pixels);
    Colors sum = Colors::none();
    V total = hn::Zero(d);
    for (std::size_t c = 0; c < 3; ++c) {
      const Places at(pass, entries, samples, chords, c, k);
      const Agreement<kHalf> agreement(pass, at, estimates.aim[c], k);
      Colors v[3];
      V w[3], agreed = hn::Zero(d);
      for (std::size_t e = 0; e < 3; ++e) {
        v[e] = load_colors(colors_of<kHalf>(samples)[3 * c + e], k);
        w[e] = hn::LoadU(d, &pass.exit[c]->weight[e][k]);
        agreed = hn::Add(agreed, agreement.of(w[e], at.depth[e], v[e].a));
        range.add(ColorRange::of(v[e]));
      }
      const V weight = hn::Mul(hn::LoadU(d, &entries.weight[c][k]), agreed);
      sum = sum.plus(weight, bend<kHalf>(v, w, *pass.exit[c], samples, c, k));
      total = hn::Add(total, weight);
    }
    const Colors bent = range.clamp(pixels.plus(hn::Div(hn::Set(d, 1.f), total), sum));
    store_pixels(bent.times(hn::Set(d, 1 / kFullScale<kHalf>)), rays, k, picture);
  }
}

void add_cubic_any(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
                   const BlockSamples& samples, bool half_floats, const DepthEstimates& estimates,
                   glm::vec4* picture) {
  (half_floats ? add_cubic_typed<true> : add_cubic_typed<false>)(pass, rays, entries, samples,
                                                                 estimates, picture);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(blend_any);
HWY_EXPORT(add_cubic_any);

void blend(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
           const BlockSamples& samples, bool half_floats, glm::vec4* picture,
           DepthEstimates& estimates) {
  HWY_DYNAMIC_DISPATCH(blend_any)
  (pass, rays, entries, samples, half_floats, picture, estimates);
}

void add_cubic(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
               const BlockSamples& samples, bool half_floats, const DepthEstimates& estimates,
               glm::vec4* picture) {
  HWY_DYNAMIC_DISPATCH(add_cubic_any)
  (pass, rays, entries, samples, half_floats, estimates, picture);
}

}  // namespace slf
#endif  // HWY_ONCE
