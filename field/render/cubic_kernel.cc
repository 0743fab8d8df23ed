#include "field/render/cubic_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/render/cubic_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include "field/render/blend_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

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

HWY_EXPORT(add_cubic_any);

void add_cubic(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
               const BlockSamples& samples, bool half_floats, const DepthEstimates& estimates,
               glm::vec4* picture) {
  HWY_DYNAMIC_DISPATCH(add_cubic_any)
  (pass, rays, entries, samples, half_floats, estimates, picture);
}

}  // namespace slf
#endif  // HWY_ONCE
