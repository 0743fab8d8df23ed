#include "slf/scene.h"

#include <cassert>

namespace slf {

void Scene::trace_many(std::span<const Segment> rays, std::span<RaySample> out) const {
  assert(rays.size() == out.size());
  for (std::size_t k = 0; k < rays.size(); ++k) out[k] = trace(rays[k].from, rays[k].to);
}

}  // namespace slf
