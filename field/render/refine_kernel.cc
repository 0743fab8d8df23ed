#include "field/render/refine_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "field/render/refine_kernel.cc"
#include <hwy/foreach_target.h>  // compiles this file once per instruction set

#include "field/render/render_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

void compact_unconverged_any(float threshold, RayBlock& rays, DepthEstimates& estimates) {
  const D d;
  std::size_t n = 0;
  for (std::size_t k = 0; k < rays.count; k += hn::Lanes(d)) {
    const auto unconverged =
        hn::And(hn::Gt(hn::LoadU(d, &estimates.step[k]), hn::Set(d, threshold)),
                hn::FirstN(d, rays.count - k));
    if (hn::AllFalse(d, unconverged)) continue;
    const bool all = hn::AllTrue(d, unconverged);
    store_chosen(Point::load(rays.enter, k), all, unconverged, rays.enter, n);
    store_chosen(Point::load(rays.leave, k), all, unconverged, rays.leave, n);
    store_chosen(hn::LoadU(DU(), &rays.pixel[k]), all, unconverged, DU(), &rays.pixel[n]);
    for (auto& aim : estimates.aim)
      store_chosen(hn::LoadU(d, &aim[k]), all, unconverged, d, &aim[n]);
    store_chosen(hn::LoadU(d, &estimates.t[k]), all, unconverged, d, &estimates.t[n]);
    n += hn::CountTrue(d, unconverged);
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

HWY_EXPORT(compact_unconverged_any);
HWY_EXPORT(aim_at_depth_any);

void compact_unconverged(float threshold, RayBlock& rays, DepthEstimates& estimates) {
  HWY_DYNAMIC_DISPATCH(compact_unconverged_any)(threshold, rays, estimates);
}

void aim_at_depth(const RayBlock& rays, const EntryCells& entries, const DepthEstimates& estimates,
                  std::array<PointArrays, 3>& exits) {
  HWY_DYNAMIC_DISPATCH(aim_at_depth_any)(rays, entries, estimates, exits);
}

}  // namespace slf
#endif  // HWY_ONCE
