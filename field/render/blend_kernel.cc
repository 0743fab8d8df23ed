#include "field/render/blend_kernel.h"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/render/blend_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include "field/render/render_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

struct Colors {
  V r, g, b, a;

  static HWY_INLINE Colors none() {
    const V zero = hn::Zero(D());
    return {zero, zero, zero, zero};
  }
  HWY_INLINE Colors times(V t) const {
    return {hn::Mul(r, t), hn::Mul(g, t), hn::Mul(b, t), hn::Mul(a, t)};
  }
  HWY_INLINE Colors plus(V t, const Colors& c) const {
    return {hn::MulAdd(t, c.r, r), hn::MulAdd(t, c.g, g), hn::MulAdd(t, c.b, b),
            hn::MulAdd(t, c.a, a)};
  }
};

HWY_INLINE Colors load_colors(const RayArray<std::uint32_t>& from, std::size_t k) {
  const VU v = hn::LoadU(DU(), from.data() + k);
  return {byte_of<0>(v), byte_of<1>(v), byte_of<2>(v), byte_of<3>(v)};
}

HWY_INLINE Colors load_colors(const RayArray<std::uint64_t>& from, std::size_t k) {
  const hn::Rebind<std::uint16_t, D> bits;
  const hn::Rebind<hwy::float16_t, D> half;
  hn::Vec<decltype(bits)> r, g, b, a;
  hn::LoadInterleaved4(bits, reinterpret_cast<const std::uint16_t*>(from.data() + k), r, g, b, a);
  const auto to_float = [&](auto v) { return hn::PromoteTo(D(), hn::BitCast(half, v)); };
  return {to_float(r), to_float(g), to_float(b), to_float(a)};
}

/// Writes the pixels of the rays from `k` on.
HWY_INLINE void store_pixels(const Colors& colors, const RayBlock& rays, std::size_t k,
                             glm::vec4* picture) {
  const D d;
  HWY_ALIGN glm::vec4 pixels[hn::MaxLanes(D())];
  hn::StoreInterleaved4(colors.r, colors.g, colors.b, colors.a, d, &pixels[0].x);
  const std::size_t n = std::min(hn::Lanes(d), rays.count - k);
  const std::uint32_t* to = &rays.pixel[k];
  const DU du;
  const VU step = hn::Sub(hn::LoadU(du, to + 1), hn::LoadU(du, to));
  const VU place =
      hn::And(hn::Iota(du, 1), hn::Set(du, PixelSquare::kAcross - 1));  // 0 where a run ends
  const auto runs = hn::Or(hn::Eq(step, hn::Set(du, 1)), hn::Eq(place, hn::Zero(du)));
  if (n == hn::Lanes(d) && hn::AllTrue(du, runs)) {
    for (std::size_t i = 0; i < n; i += PixelSquare::kAcross)
      std::copy_n(pixels + i, PixelSquare::kAcross, picture + to[i]);
  } else {
    for (std::size_t i = 0; i < n; ++i) picture[to[i]] = pixels[i];
  }
}

/// Rays and samples below this opacity have no depth.
constexpr float kFaintOpacity = 1.f / 255;
/// The share of its weight that a sample at another depth keeps, so that the sum of weights is
/// never 0.
constexpr float kMinAgreement = 0.1f;
/// From this opacity on, a sample at another depth loses the full share of its weight; below, a
/// part proportional to its opacity.
constexpr float kReliableOpacity = 0.25f;

/// The stored value that stands for 1.
template <bool kHalf>
constexpr float kFullScale = kHalf ? 1.f : 255.f;

template <bool kHalf>
HWY_INLINE const auto& colors_of(const BlockSamples& samples) {
  if constexpr (kHalf)
    return samples.rgba16f;
  else
    return samples.rgba8;
}

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
  const V max_lost = hn::Set(d, 1 - kMinAgreement);
  const V by_opacity = hn::Set(d, (1 - kMinAgreement) / (kReliableOpacity * kFullScale<kHalf>));
  const V sharpness = hn::Set(d, kRefine ? 1 / pass.depth_tolerance : 0.f);
  const auto mean = [&](V of, V weight) {  // in 0..1 even if half floats are infinite or NaN
    const V at = hn::Div(of, weight);
    return hn::IfThenElseZero(hn::Gt(at, zero), hn::Min(at, one));
  };
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    if (!kRefine && all_zero<kHalf>(pass, samples, k)) {
      for (std::size_t c = 0; c < 3; ++c) store(zero, estimates.aim[c], k);
      store(zero, estimates.step, k);
      store(zero, estimates.t, k);
      store_pixels(Colors::none(), rays, k, picture);
      continue;
    }
    Colors sum = Colors::none();
    V total = zero;  // sum of the weights
    V opacity = zero,
      place = zero;             // sums of opacity, and of opacity times depth along the ray
    V opacities[3], places[3];  // the same, by entry vertex
    const Point enter = Point::load(rays.enter, k);
    const Point ray = Point::load(rays.leave, k).minus(enter);
    const V inverse = hn::Div(one, ray.dot(ray));
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const V weight = hn::LoadU(d, &entries.weight[c][k]);
      const VU three = hn::LoadU(DU(), &samples.depth[c][k]);
      const V depths[] = {byte_of<0>(three), byte_of<1>(three), byte_of<2>(three)};
      // The depth along the ray of a sample of this entry vertex is begin + depth · scale.
      const Point from = Point::load(entries.point[c], k);
      const Point aim = Point::load(*pass.aim[c], k).minus(from);
      const V begin = hn::Mul(from.minus(enter).dot(ray), inverse);
      const V scale = hn::Mul(aim.dot(ray), hn::Mul(inverse, hn::Set(d, 1.f / 255)));
      V opacity_c = zero, depth = zero, offset = zero, slope = zero;
      if constexpr (kRefine) {
        offset = hn::Mul(hn::Sub(begin, hn::LoadU(d, &estimates.aim[c][k])), sharpness);
        slope = hn::Mul(scale, sharpness);
      }
      for (std::size_t e = 0; e < 3; ++e) {
        const V share = hn::Mul(weight, hn::LoadU(d, &pass.exit[c]->weight[e][k]));
        const Colors v = load_colors(colors_of<kHalf>(samples)[3 * c + e], k);
        const V visible = hn::Mul(share, v.a);
        opacity_c = hn::Add(opacity_c, visible);
        depth = hn::MulAdd(visible, depths[e], depth);
        if constexpr (kRefine) {
          const V off = hn::MulAdd(depths[e], slope, offset);
          const V apart = hn::Min(hn::Mul(off, off), one);
          const V lost = hn::Mul(apart, hn::Min(hn::Mul(v.a, by_opacity), max_lost));
          const V w = hn::NegMulAdd(lost, share, share);
          total = hn::Add(total, w);
          sum = sum.plus(w, v);
        }
      }
      opacities[c] = opacity_c;
      places[c] = hn::MulAdd(opacity_c, begin, hn::Mul(depth, scale));
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
        store(next, estimates.aim[c], k);
      }
    } else {
      ray_depth = hn::IfThenElseZero(hn::Gt(opacity, zero), ray_depth);
      step = hn::IfThenElseZero(enough, hn::Inf(d));
      for (std::size_t c = 0; c < 3; ++c) store(ray_depth, estimates.aim[c], k);
    }
    store(step, estimates.step, k);
    store(ray_depth, estimates.t, k);
    if constexpr (kRefine)
      store_pixels(sum.times(hn::Div(hn::Set(d, 1 / kFullScale<kHalf>), total)), rays, k, picture);
    else if (!pass.first_of_more || !hn::AllTrue(d, enough))
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

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(blend_any);

void blend(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
           const BlockSamples& samples, bool half_floats, glm::vec4* picture,
           DepthEstimates& estimates) {
  HWY_DYNAMIC_DISPATCH(blend_any)
  (pass, rays, entries, samples, half_floats, picture, estimates);
}

}  // namespace slf
#endif  // HWY_ONCE
