#include "field/render/refine_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/render/refine_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include "field/render/render_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

/// Appends the chosen rays of those from `k` on, with these aims. The destination may begin at or
/// before the source.
HWY_INLINE void append(const RayBlock& rays, const DepthEstimates& estimates,
                       const std::array<RayArray<float>, 3>& aims, std::size_t k,
                       hn::Mask<D> chosen, std::size_t& n, RayBlock& to_rays,
                       DepthEstimates& to_estimates) {
  const D d;
  const bool all = hn::AllTrue(d, chosen);
  store_chosen(Point::load(rays.enter, k), all, chosen, to_rays.enter, n);
  store_chosen(Point::load(rays.leave, k), all, chosen, to_rays.leave, n);
  store_chosen(hn::LoadU(DU(), &rays.pixel[k]), all, chosen, DU(), &to_rays.pixel[n]);
  for (std::size_t c = 0; c < 3; ++c)
    store_chosen(hn::LoadU(d, &aims[c][k]), all, chosen, d, &to_estimates.aim[c][n]);
  store_chosen(hn::LoadU(d, &estimates.t[k]), all, chosen, d, &to_estimates.t[n]);
  n += hn::CountTrue(d, chosen);
}

void separate_rays_any(float threshold, float contrast, RayBlock& rays, DepthEstimates& estimates,
                       RayBlock& contrast_rays, DepthEstimates& contrast_estimates) {
  const D d;
  std::size_t n = 0;
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const auto valid = hn::FirstN(d, rays.count - k);
    const auto moving = hn::Gt(hn::LoadU(d, &estimates.step[k]), hn::Set(d, threshold));
    const auto contrasts = hn::Ge(hn::LoadU(d, &estimates.contrast[k]), hn::Set(d, contrast));
    const auto unconverged = hn::And(moving, valid);
    const auto ended = hn::AndNot(moving, hn::And(contrasts, valid));
    if (!hn::AllFalse(d, ended))
      append(rays, estimates, estimates.aim, k, ended, contrast_rays.count, contrast_rays,
             contrast_estimates);
    if (!hn::AllFalse(d, unconverged))
      append(rays, estimates, estimates.next, k, unconverged, n, rays, estimates);
  }
  rays.count = n;
}

void aim_at_depth_any(const RayBlock& rays, const EntryCells& entries,
                      const DepthEstimates& estimates, std::array<PointArrays, 3>& exits) {
  const D d;
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const Point enter = Point::load(rays.enter, k);
    const Point ray = Point::load(rays.leave, k).minus(enter);
    for (std::size_t c = 0; c < 3; ++c) {
      const Point target = enter.plus(hn::LoadU(d, &estimates.aim[c][k]), ray);
      const Point from = Point::load(entries.point[c], k);
      const Point along = target.minus(from);
      const V length2 = along.dot(along);
      const V far = hn::Div(hn::Mul(hn::Set(d, -2.f), from.dot(along)), length2);
      from.plus(hn::IfThenElseZero(hn::Gt(length2, hn::Zero(d)), far), along).store_to(exits[c], k);
    }
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slf {

HWY_EXPORT(separate_rays_any);
HWY_EXPORT(aim_at_depth_any);

void separate_rays(float threshold, float contrast, RayBlock& rays, DepthEstimates& estimates,
                   RayBlock& contrast_rays, DepthEstimates& contrast_estimates) {
  HWY_DYNAMIC_DISPATCH(separate_rays_any)
  (threshold, contrast, rays, estimates, contrast_rays, contrast_estimates);
}

void aim_at_depth(const RayBlock& rays, const EntryCells& entries, const DepthEstimates& estimates,
                  std::array<PointArrays, 3>& exits) {
  HWY_DYNAMIC_DISPATCH(aim_at_depth_any)(rays, entries, estimates, exits);
}

}  // namespace slf
#endif  // HWY_ONCE
