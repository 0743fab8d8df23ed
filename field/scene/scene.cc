#include "slf/scene.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <optional>
#include <vector>

#include "base/guarded.h"
#include "base/reporter.h"
#include "base/try.h"

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

Result<Image> trace_view(const Scene& scene, const Sphere& sphere, const Camera& camera,
                         unsigned threads, const ProgressCallback& progress) {
  const auto rays = SLF_TRY(RayGenerator::make(camera));
  Image image;
  image.width = camera.width;
  image.height = camera.height;
  image.rgba.resize(std::size_t{camera.width} * camera.height);
  image.depth.assign(image.rgba.size(), std::numeric_limits<float>::infinity());
  const auto segment = [&](const PixelRay& ray) -> std::optional<Segment> {
    const Chord chord = intersect(sphere, ray.origin, ray.direction);
    if (!chord.hit || chord.leave <= 0) return std::nullopt;
    return Segment{ray.origin + std::max(chord.enter, 0.0) * ray.direction,
                   ray.origin + chord.leave * ray.direction};
  };
  const auto some_rays = [&] {
    std::vector<Segment> some;  // few, and still close to each other
    const std::uint32_t step = 1 + std::max(camera.width, camera.height) / 512;
    for (std::uint32_t y = 0; y < camera.height; y += step)
      for (std::uint32_t x = 0; x < camera.width; x += step)
        if (const auto ray = segment(rays.ray(x, y))) some.push_back(*ray);
    return some;
  };
  SLF_TRY(guarded([&] { return scene.prepare_for(some_rays); }));
  Reporter reporter(progress, {0, camera.height, 0}, "stopped while a view was traced");
  SLF_TRY(parallel_for(camera.height, threads, reporter, [&](std::uint64_t y) {
    std::vector<Segment> segments;
    std::vector<std::uint32_t> columns;
    for (std::uint32_t x = 0; x < camera.width; ++x) {
      if (const auto ray = segment(rays.ray(x, static_cast<std::uint32_t>(y)))) {
        segments.push_back(*ray);
        columns.push_back(x);
      }
    }
    std::vector<RaySample> samples(segments.size());
    scene.trace_many(segments, samples);
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const RaySample& sample = samples[k];
      const auto& [from, to] = segments[k];
      const std::size_t pixel = y * camera.width + columns[k];
      image.rgba[pixel] = sample.rgba;
      if (sample.rgba.a > 0)
        image.depth[pixel] = static_cast<float>(
            glm::distance(rays.ray(columns[k], static_cast<std::uint32_t>(y)).origin,
                          from + double{sample.depth} * (to - from)));
    }
  }));
  return image;
}

}  // namespace slf
