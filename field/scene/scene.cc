#include "slf/scene.h"

#include <cassert>

#include "base/guarded.h"

namespace slf {

void Scene::trace_many(std::span<const Segment> rays, std::span<RaySample> out) const {
  assert(rays.size() == out.size());
  for (std::size_t k = 0; k < rays.size(); ++k) out[k] = trace(rays[k].from, rays[k].to);
}

double Scene::reach(const glm::dvec3& from) const {
  const Sphere all = bounds();
  return glm::distance(from, all.center) + all.radius;
}

// NOLINTNEXTLINE(performance-unnecessary-value-param): scenes that share it keep it
Result<void> Scene::share_light(std::shared_ptr<const Scene> /*from*/) const {
  return guarded([&] {
    return fail(ErrorCode::usage, "only volumes under shadowed or global light share it");
  });
}

}  // namespace slf
