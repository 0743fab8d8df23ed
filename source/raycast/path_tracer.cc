// Kroes, Post, Botha 2012, with the sections of that paper in comments. Deliberately plain: light
// is estimated at every vertex of a path, the surroundings only where a path leaves the volume.

#include "slf/path_tracer.h"

#include <algorithm>
#include <bit>
#include <limits>

#include "base/try.h"
#include "source/light/illumination.h"
#include "source/medium/medium.h"
#include "source/raycast/prepared_volume.h"

namespace slf {

struct PathTracer::State {
  explicit State(std::unique_ptr<PreparedVolume> s, const PathTraceOptions& p)
      : scene(std::move(s)),
        medium(scene->grid),
        illumination(illuminate(scene->lighting, scene->bounds)),
        tone(scene->lighting.tone),
        paths(p) {}

  std::unique_ptr<PreparedVolume> scene;
  Medium medium;
  Illumination illumination;
  ToneMapper tone;
  PathTraceOptions paths;

  /// Radiance that a point scatters towards the eye.
  [[nodiscard]] glm::vec3 scattered(glm::dvec3 at, Random& random) const;
  /// Light from all lights that reaches a point and is scattered there.
  [[nodiscard]] glm::vec3 lights(const Matter& matter, Random& random) const;
};

glm::vec3 PathTracer::State::lights(const Matter& matter, Random& random) const {
  glm::vec3 sum(0);
  for (const PlacedLight& light : illumination.lights) {
    const double u = random(), v = random();
    const IncidentLight arrival = light.incident_light(medium.world(matter.start), u, v);
    const double kernel = matter.kernel(arrival.direction);
    if (kernel > 0 &&
        !medium.fly(matter.start, medium.per_world(arrival.direction), arrival.distance, random))
      sum += static_cast<float>(kernel) * arrival.irradiance;
  }
  return sum;
}

glm::vec3 PathTracer::State::scattered(glm::dvec3 at, Random& random) const {
  const LightOptions& options = scene->lighting;
  const std::uint32_t bounces = options.mode == Lighting::global ? options.bounces : 0;
  glm::vec3 throughput(1), sum(0);
  for (std::uint32_t bounce = 0;; ++bounce) {
    // Surface or phase function: a choice by the gradient ("Hybrid scattering").
    const Matter matter = medium.matter(at);
    throughput *= matter.albedo;
    sum += throughput * lights(matter, random);
    const double choice = random(), u = random(), v = random();
    const glm::dvec3 direction = matter.sample(choice, u, v);
    const glm::dvec3 along = medium.per_world(direction);
    // Woodcock tracking to the next vertex ("Volume sampling").
    const auto t = medium.fly(matter.start, along, std::numeric_limits<double>::infinity(), random);
    if (!t) return sum + throughput * illumination.environment.radiance(direction);
    if (bounce == bounces) return sum;
    at = matter.start + *t * along;
    const double survival =
        std::min(1.0, 2.0 * std::max({throughput.r, throughput.g, throughput.b}));
    if (random() >= survival) return sum;  // Russian roulette
    throughput /= static_cast<float>(survival);
  }
}

PathTracer::PathTracer(std::unique_ptr<State> state) : state_(std::move(state)) {}
PathTracer::~PathTracer() = default;

Result<std::unique_ptr<PathTracer>> PathTracer::make(Volume volume,
                                                     const TransferFunction& transfer,
                                                     const RaycastOptions& options,
                                                     const PathTraceOptions& paths) try {
  if (options.lighting.mode == Lighting::direct)
    return fail(ErrorCode::usage,
                "path tracing: direct light has no model of light transport; "
                "choose shadowed or global");
  if (paths.samples == 0) return fail(ErrorCode::usage, "path tracing: 0 samples: expected 1");
  auto scene = SLF_TRY(prepare_volume(std::move(volume), transfer, options));
  return std::unique_ptr<PathTracer>(
      new PathTracer(std::make_unique<State>(std::move(scene), paths)));
} catch (...) {
  return tl::unexpected(error_of_exception());
}

RaySample PathTracer::trace(const glm::dvec3& from, const glm::dvec3& to) const {
  const State& s = *state_;
  const double length = glm::distance(from, to);
  RaySample sample;
  if (!(length > 0)) return sample;
  std::uint64_t seed = s.paths.seed;
  for (const glm::dvec3& point : {from, to})
    for (int axis = 0; axis < 3; ++axis)
      seed = mix(seed + std::bit_cast<std::uint64_t>(point[axis]));
  Random random(seed);
  const RayGrid& grid = s.scene->grid;
  const glm::dvec3 start = grid.world_to_index * (from - grid.origin);
  const glm::dvec3 along = s.medium.per_world((to - from) / length);
  glm::dvec4 sum(0);
  double depth = 0;
  for (std::uint32_t k = 0; k < s.paths.samples; ++k)
    if (const auto t = s.medium.fly(start, along, length, random)) {
      sum += glm::dvec4(s.scattered(start + *t * along, random), 1);
      depth += *t / length;
    }
  sample.rgba = glm::vec4(sum / static_cast<double>(s.paths.samples));
  if (sum.a > 0) sample.depth = static_cast<float>(depth / sum.a);
  if (!s.scene->lighting.linear) sample.rgba = s.tone(sample.rgba);
  return sample;
}

Sphere PathTracer::bounds() const { return state_->scene->bounds; }
std::string PathTracer::provenance() const { return state_->scene->provenance; }
std::vector<std::string> PathTracer::files() const { return state_->scene->volume.files; }

}  // namespace slf
