#include <algorithm>
#include <limits>

#include "field/render/cut.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/render/cut_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include "field/render/blend_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

/// Matter of less opacity counts as none, and of more as a surface, behind which nothing shows.
constexpr float kNothing = 0.02f, kSurface = 0.98f;

/// KeptSpace::of() for a vector of rays.
struct KeptPart {
  V begin = hn::Zero(D()), end = hn::Set(D(), 1.f);

  HWY_INLINE KeptPart(const KeptSpace& kept, const Chords& rays) {
    const D d;
    const V zero = hn::Zero(d), never = hn::Set(d, -1.f);
    for (const auto& [inwards, offset] : kept.planes) {
      const Point normal = Point::set(inwards);
      const V at = hn::Add(rays.enter.dot(normal), hn::Set(d, static_cast<float>(offset)));
      const V rate = rays.along.dot(normal);
      const V meets = hn::Neg(hn::Div(at, rate));
      begin = hn::IfThenElse(hn::Gt(rate, zero), hn::Max(begin, meets), begin);
      end = hn::IfThenElse(hn::Lt(rate, zero), hn::Min(end, meets), end);
      end = hn::IfThenElse(hn::And(hn::Eq(rate, zero), hn::Lt(at, zero)), never, end);
    }
    if (!kept.eye_inside) return;
    const V eye = Point::set(kept.eye).minus(rays.enter).dot(rays.along);
    begin = hn::Max(begin, hn::Mul(eye, rays.inverse));
  }
};

template <bool kHalf>
HWY_INLINE auto& all_colors_of(BlockSamples& samples) {
  if constexpr (kHalf)
    return samples.rgba16f;
  else
    return samples.rgba8;
}

template <bool kHalf>
void cut_samples_typed(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
                       const KeptSpace& kept, BlockSamples& samples,
                       RayArray<std::uint32_t>& became) {
  const D d;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.f);
  const V nothing = hn::Set(d, kNothing * kFullScale<kHalf>);
  const V surface = hn::Set(d, kSurface * kFullScale<kHalf>);
  const auto no = hn::Lt(one, zero);
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const Chords chords(rays, k);
    const KeptPart part(kept, chords);
    const auto crosses = hn::Or(hn::Gt(part.begin, zero), hn::Lt(part.end, one));
    auto any_kept = no, any_cut = no, any_before = no, any_thin = no, any_surface = no;
    for (std::size_t c = 0; c < pass.entries; ++c) {
      const Places at(pass, entries, samples, chords, c, k);
      for (std::size_t e = 0; e < 3; ++e) {
        auto& colors = all_colors_of<kHalf>(samples)[3 * c + e];
        const V alpha = load_colors(colors, k).a;
        const V t = hn::MulAdd(at.depth[e], at.scale, at.begin);
        const auto before = hn::Lt(t, part.begin);
        const auto cut = hn::And(crosses, hn::Or(before, hn::Gt(t, part.end)));
        const auto matter = hn::Gt(alpha, nothing);
        any_cut = hn::Or(any_cut, hn::And(cut, matter));
        any_kept = hn::Or(any_kept, hn::AndNot(cut, matter));
        any_before = hn::Or(any_before, hn::And(before, matter));
        any_thin = hn::Or(any_thin, hn::And(matter, hn::Lt(alpha, surface)));
        any_surface = hn::Or(any_surface, hn::Ge(alpha, surface));
        if (hn::AllFalse(d, cut)) continue;
        HWY_ALIGN float removed[hn::MaxLanes(D())];
        hn::Store(hn::IfThenElseZero(cut, one), d, removed);
        for (std::size_t lane = 0; lane < hn::Lanes(d); ++lane)
          if (removed[lane] != 0) colors[k + lane] = 0;
      }
    }
    const auto divided =
        hn::Or(hn::AndNot(any_surface, any_thin),
               hn::And(crosses, hn::Or(hn::Or(any_before, any_thin), hn::And(any_cut, any_kept))));
    const auto value = [](CutRay ray) { return hn::Set(DU(), static_cast<std::uint32_t>(ray)); };
    const DU du;
    hn::StoreU(hn::IfThenElse(hn::RebindMask(du, divided), value(CutRay::divided),
                              hn::IfThenElse(hn::RebindMask(du, any_cut), value(CutRay::cut),
                                             value(CutRay::whole))),
               du, became.data() + k);
  }
}

void cut_samples_any(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
                     const KeptSpace& kept, bool half_floats, BlockSamples& samples,
                     RayArray<std::uint32_t>& became) {
  (half_floats ? cut_samples_typed<true> : cut_samples_typed<false>)(pass, rays, entries, kept,
                                                                     samples, became);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(cut_samples_any);

void cut_samples(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
                 const KeptSpace& kept, bool half_floats, BlockSamples& samples,
                 RayArray<std::uint32_t>& became) {
  HWY_DYNAMIC_DISPATCH(cut_samples_any)
  (pass, rays, entries, kept, half_floats, samples, became);
}

KeptSpace::KeptSpace(std::span<const ClipPlane> clip, const Sphere& sphere,
                     const glm::dvec3& world_eye)
    : eye((world_eye - sphere.center) / sphere.radius),
      eye_inside(!clip.empty() && glm::length(eye) < 1) {
  for (const auto& [point, normal] : clip) {
    const glm::dvec3 inwards = -glm::normalize(normal);
    const double offset = -glm::dot(inwards, point - sphere.center) / sphere.radius;
    if (offset < 1) planes.push_back({inwards, offset});  // others miss the sphere
  }
}

KeptSpace::Part KeptSpace::of(const glm::dvec3& enter, const glm::dvec3& leave) const {
  Part part;
  const glm::dvec3 along = leave - enter;
  for (const auto& [inwards, offset] : planes) {
    const double at = glm::dot(inwards, enter) + offset, rate = glm::dot(inwards, along);
    if (rate > 0) part.begin = std::max(part.begin, -at / rate);
    if (rate < 0) part.end = std::min(part.end, -at / rate);
    if (rate == 0 && at < 0) part.end = 0;
  }
  if (eye_inside)
    part.begin = std::max(part.begin, glm::dot(eye - enter, along) / glm::dot(along, along));
  return part;
}

}  // namespace slf
#endif  // HWY_ONCE
