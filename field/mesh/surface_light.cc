#include "field/mesh/surface_light.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <new>
#include <numbers>

#include "base/half.h"

namespace slf {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr unsigned kMaxBounces = 3;  // further ones change nothing that is visible
constexpr int kMaxResolution = 4096;
constexpr unsigned kDiscSamples = 16;  // of a light that has a size
constexpr double kLift = 2e-5;         // from the surface, so that rays do not meet it

/// Element k of the van der Corput sequence.
double radical_inverse(std::uint32_t k) {
  double value = 0, digit = 0.5;
  for (; k != 0; k >>= 1, digit /= 2) value += (k & 1) * digit;
  return value;
}

/// Directions on a spiral, each in the middle of an equal area (Swinbank, Purser 2006).
std::vector<glm::dvec3> even_directions(unsigned count) {
  std::vector<glm::dvec3> directions;
  for (unsigned k = 0; k < count; ++k) {
    const double z = 1 - (2.0 * k + 1) / count, r = std::sqrt(1 - z * z);
    const double angle = kPi * (3 - std::sqrt(5.0)) * k;
    directions.emplace_back(r * std::cos(angle), r * std::sin(angle), z);
  }
  return directions;
}

std::uint64_t pack(const glm::vec3& light) {
  std::uint64_t word = std::uint64_t{1} << 48;
  for (int c = 0; c < 3; ++c)
    word |= std::uint64_t{half_from_float(std::min(light[c], 65504.f))} << 16 * c;
  return word;
}
glm::vec3 unpack(std::uint64_t word) {
  glm::vec3 light;
  for (int c = 0; c < 3; ++c) light[c] = half_to_float(static_cast<std::uint16_t>(word >> 16 * c));
  return light;
}

/// The number of a node in the grid of its triangle; row j has resolution + 1 - j nodes.
std::uint64_t number(int i, int j, int resolution) {
  return static_cast<std::uint64_t>(j) * static_cast<std::uint64_t>(2 * resolution + 3 - j) / 2 +
         static_cast<std::uint64_t>(i);
}

}  // namespace

SurfaceLight::SurfaceLight(const Surface& surface, const LightOptions& options)
    : surface_(surface),
      bounces_(options.mode == Lighting::global ? std::min(options.bounces, kMaxBounces) : 0) {
  for (const Light& light : options.rig.lights)
    if (const PlacedLight placed(light, surface.bounds()); !placed.dark())
      sources_.push_back({placed, light.size > 0 ? kDiscSamples : 1});
  sphere_ = even_directions(2 * options.samples);  // one side of a surface sees half of them
  const Environment environment = options.environment
                                      ? Environment(*options.environment, options.environment_gain)
                                      : Environment(options.rig.sky);
  even_sky_ = !environment.peaked();
  if (!environment.dark()) {
    for (unsigned k = 0; k < 2 * options.samples; ++k) {
      if (even_sky_) {
        sky_.push_back({sphere_[k], environment.radiance(sphere_[k])});
        continue;
      }
      const double choice = (k + 0.5) / (2 * options.samples);
      const double golden = k / std::numbers::phi;
      const auto sample =
          environment.sample(choice, radical_inverse(k), golden - std::floor(golden));
      const double weight = 1 / (kPi * sample.density * 2 * options.samples);
      sky_.push_back({sample.direction, static_cast<float>(weight) * sample.radiance});
    }
  }
  place_nodes(options);
}

void SurfaceLight::place_nodes(const LightOptions& options) {
  const std::size_t triangles = surface_.mesh().triangles.size();
  // In local coordinates.
  spacing_ = options.spacing / 256 *
             glm::distance(surface_.to_local(surface_.bounds().center),
                           surface_.to_local(surface_.bounds().center +
                                             glm::dvec3(surface_.bounds().radius, 0, 0)));
  const std::uint64_t per_node = std::uint64_t{8} * 2 * (bounces_ + 1);
  const std::uint64_t allowed = std::max(options.memory / per_node, std::uint64_t{3} * triangles);
  first_.assign(triangles + 1, 0);
  for (;; spacing_ *= 1.25) {
    for (std::size_t k = 0; k < triangles; ++k) {
      const int n = resolution(static_cast<std::uint32_t>(k));
      first_[k + 1] = first_[k] + number(0, n, n) + 1;
    }
    if (first_.back() <= allowed) break;
  }
  known_.reset(static_cast<std::uint64_t*>(std::calloc(first_.back() * 2 * (bounces_ + 1), 8)));
  if (!known_) throw std::bad_alloc();
}

int SurfaceLight::resolution(std::uint32_t triangle) const {
  const Mesh& mesh = surface_.mesh();
  const glm::uvec3& t = mesh.triangles[triangle];
  double longest = 0;
  for (int c = 0; c < 3; ++c)
    longest = std::max(longest, glm::distance(glm::dvec3(mesh.positions[t[c]]),
                                              glm::dvec3(mesh.positions[t[(c + 1) % 3]])));
  return std::clamp(static_cast<int>(std::ceil(longest / spacing_)), 1, kMaxResolution);
}

glm::vec3 SurfaceLight::at(const SurfacePoint& point, unsigned bounces) const {
  const int n = resolution(point.triangle);
  const double x = point.at.x * n, y = point.at.y * n;
  const int j = std::clamp(static_cast<int>(y), 0, n - 1);
  const int i = std::clamp(static_cast<int>(x), 0, n - 1 - j);
  auto u = static_cast<float>(std::clamp(x - i, 0.0, 1.0));
  auto v = static_cast<float>(std::clamp(y - j, 0.0, 1.0));
  const auto node = [&](int right, int up) {
    return at(Node{point.triangle, point.back, i + right, j + up, n}, bounces);
  };
  if (u + v > 1 && i + j < n - 1)
    return (u + v - 1) * node(1, 1) + (1 - u) * node(0, 1) + (1 - v) * node(1, 0);
  if (u + v > 1) u /= u + v, v = 1 - u;
  return (1 - u - v) * node(0, 0) + u * node(1, 0) + v * node(0, 1);
}

glm::vec3 SurfaceLight::at(const Node& node, unsigned bounces) const {
  const std::uint64_t index = (std::uint64_t{bounces} * 2 + node.back) * first_.back() +
                              first_[node.triangle] + number(node.i, node.j, node.resolution);
  const std::atomic_ref<std::uint64_t> word(known_[index]);
  if (const std::uint64_t value = word.load(std::memory_order_relaxed)) return unpack(value);
  const glm::vec3 light = bounces == 0 ? direct(node) : at(node, 0) + reflected(node, bounces);
  const std::uint64_t value = pack(light);
  word.store(value, std::memory_order_relaxed);
  return unpack(value);  // as any later call returns
}

SurfaceLight::Place SurfaceLight::place(const Node& node) const {
  // Not on the edge, where other triangles begin.
  const glm::dvec2 edge = glm::dvec2(node.i, node.j) / static_cast<double>(node.resolution);
  const SurfacePoint point{
      node.triangle, glm::mix(edge, glm::dvec2(1.0 / 3), 0.05 / node.resolution), 0, node.back};
  Place place{surface_.position(point), surface_.normal(point), surface_.face_normal(point)};
  place.from += kLift * glm::dvec3(place.face);
  return place;
}

glm::vec3 SurfaceLight::direct(const Node& node) const {
  const Place p = place(node);
  const auto visible = [&](const glm::dvec3& direction, double distance) {
    return glm::dot(glm::dvec3(p.face), direction) > 0 &&
           !surface_.blocked(p.from, direction, distance);
  };
  const glm::dvec3 normal(p.normal), world = surface_.to_world(p.from);
  glm::vec3 light(0);
  for (const Source& source : sources_)
    for (unsigned k = 0; k < source.samples; ++k) {
      const double u = source.samples == 1 ? 0 : (k + 0.5) / source.samples;
      const IncidentLight in = source.light.incident_light(world, u, radical_inverse(k));
      const double cosine = glm::dot(normal, in.direction);
      if (!(cosine > 0)) continue;
      const double far =
          std::isinf(in.distance)
              ? in.distance
              : glm::distance(p.from, surface_.to_local(world + in.distance * in.direction));
      if (visible(in.direction, far))
        light += static_cast<float>(cosine / (kPi * source.samples)) * in.irradiance;
    }
  glm::vec3 sky(0);
  double weights = 0;
  for (const Ray& ray : sky_) {
    const double cosine = glm::dot(normal, ray.direction);
    if (!(cosine > 0)) continue;
    weights += cosine;
    if (visible(ray.direction, std::numeric_limits<double>::infinity()))
      sky += static_cast<float>(cosine) * ray.radiance;
  }
  if (even_sky_ && weights > 0) sky /= static_cast<float>(weights);
  return light + sky;
}

glm::vec3 SurfaceLight::reflected(const Node& node, unsigned bounces) const {
  const Place p = place(node);
  glm::vec3 light(0);
  double weights = 0;
  for (const glm::dvec3& direction : sphere_) {
    const double cosine = glm::dot(glm::dvec3(p.normal), direction);
    if (!(cosine > 0)) continue;
    weights += cosine;
    if (glm::dot(glm::dvec3(p.face), direction) <= 0) continue;
    const auto hit = surface_.first(p.from, direction, 0, std::numeric_limits<double>::infinity());
    if (!hit) continue;
    const glm::vec4 color = surface_.color(*hit);
    light += static_cast<float>(cosine) * color.a * glm::vec3(color) * at(*hit, bounces - 1);
  }
  return weights > 0 ? light / static_cast<float>(weights) : light;
}

}  // namespace slf
