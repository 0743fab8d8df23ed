#include "field/view.h"

#include <algorithm>
#include <limits>

#include "field/parallel.h"

namespace slf {

Result<Image> trace_view(const Scene& scene, const Sphere& sphere, const Camera& camera,
                         unsigned threads) {
  const auto rays = RayGenerator::make(camera);
  if (!rays) return tl::unexpected(rays.error());
  Image image;
  image.width = camera.width;
  image.height = camera.height;
  image.rgba.resize(std::size_t{camera.width} * camera.height);
  image.depth.assign(image.rgba.size(), std::numeric_limits<float>::infinity());
  parallel_for(camera.height, threads, [&](std::uint64_t y) {
    for (std::uint32_t x = 0; x < camera.width; ++x) {
      const PixelRay ray = rays->ray(x, static_cast<std::uint32_t>(y));
      const Chord chord = intersect(sphere, ray.origin, ray.direction);
      if (!chord.hit || chord.leave <= 0) continue;
      const glm::dvec3 from = ray.origin + std::max(chord.enter, 0.0) * ray.direction;
      const glm::dvec3 to = ray.origin + chord.leave * ray.direction;
      const RaySample sample = scene.trace(from, to);
      const std::size_t pixel = y * camera.width + x;
      image.rgba[pixel] = sample.rgba;
      if (sample.rgba.a > 0)
        image.depth[pixel] = static_cast<float>(
            glm::distance(ray.origin, from + double{sample.depth} * (to - from)));
    }
  });
  return image;
}

}  // namespace slf
