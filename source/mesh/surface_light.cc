#include "source/mesh/surface_light.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <new>
#include <numbers>
#include <unordered_map>

#include "base/half.h"
#include "field/geometry/directions.h"

namespace slf {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr unsigned kMaxBounces = 3;  // further ones change nothing that is visible
constexpr int kMaxResolution = 4096;
constexpr int kCoarse = 4;             // distance of coarse nodes, in nodes
constexpr unsigned kDirections = 8;    // around a point, for each of the samples
constexpr unsigned kNearSamples = 16;  // of a light at a distance
constexpr double kLift = 2e-5;         // from the surface, so that rays do not meet it

/// Element k of the van der Corput sequence.
double radical_inverse(std::uint32_t k) {
  double value = 0, digit = 0.5;
  for (; k != 0; k >>= 1, digit /= 2) value += (k & 1) * digit;
  return value;
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

SurfaceLight::SurfaceLight(const MeshSurface& surface, const LightOptions& options)
    : surface_(surface),
      bounces_(options.mode == Lighting::global ? std::min(options.bounces, kMaxBounces) : 0) {
  const auto [lights, sky] = illuminate(options, surface.bounds());
  for (const PlacedLight& light : lights) {
    if (!light.distant()) {
      near_lights_.push_back(light);
      continue;
    }
    const auto directions = light.directions();
    const glm::vec3 share = light.incident_light(surface.bounds().center, 0, 0).irradiance /
                            static_cast<float>(kPi * static_cast<double>(directions.size()));
    for (const glm::dvec3& direction : directions) far_lights_.push_back({direction, share});
  }
  const unsigned count = kDirections * options.samples;
  for (unsigned k = 0; k < count; ++k) {
    const glm::dvec3 direction = even_direction(k, count);
    around_.push_back({direction, sky.peaked() ? glm::vec3(0) : sky.radiance(direction)});
    if (!sky.peaked()) continue;
    const double golden = k / std::numbers::phi;
    const auto sample =
        sky.sample((k + 0.5) / count, radical_inverse(k), golden - std::floor(golden));
    far_lights_.push_back(
        {sample.direction, sample.radiance / static_cast<float>(kPi * sample.density * count)});
  }
  place_nodes(options.spacing, options.memory);
  if (bounces_ > 0) choose_coarse_nodes();
}

void SurfaceLight::place_nodes(double spacing, std::uint64_t memory) {
  const std::size_t triangles = surface_.mesh().triangles.size();
  // The diameter in local coordinates, by 512.
  spacing_ = spacing * 2 * surface_.local_radius() / 512;
  const std::uint64_t per_node = std::uint64_t{8} * 2 * (bounces_ + 1);
  const std::uint64_t allowed = std::max<std::uint64_t>(memory / per_node, 3 * triangles);
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

void SurfaceLight::choose_coarse_nodes() {
  // Small triangles in the same cell, which face the same way: the first one stands for all.
  const std::size_t triangles = surface_.mesh().triangles.size();
  coarse_.resize(triangles);
  std::unordered_map<std::uint64_t, std::uint32_t> chosen;
  for (std::uint32_t k = 0; k < triangles; ++k) {
    coarse_[k] = k;
    if (resolution(k) > kCoarse) continue;
    const Place p = place({k, false, 0, 0, 0});
    const glm::i64vec3 cell(glm::floor(p.from / (kCoarse * spacing_)));
    const glm::dvec3 size = glm::abs(p.face);
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    std::uint64_t key = 2 * static_cast<std::uint64_t>(axis) + (p.face[axis] < 0 ? 1 : 0);
    for (int c = 0; c < 3; ++c) key = key << 20 | (static_cast<std::uint64_t>(cell[c]) & 0xFFFFF);
    coarse_[k] = chosen.try_emplace(key, k).first->second;
  }
}

int SurfaceLight::resolution(std::uint32_t triangle) const {
  const Mesh& mesh = surface_.mesh();
  const glm::uvec3& t = mesh.triangles[triangle];
  double longest = 0;
  for (int c = 0; c < 3; ++c)
    longest = std::max(longest, glm::distance(glm::dvec3(mesh.positions[t[c]]),
                                              glm::dvec3(mesh.positions[t[(c + 1) % 3]])));
  if (longest < spacing_ / 2) return 0;
  return std::clamp(static_cast<int>(std::ceil(longest / spacing_)), 1, kMaxResolution);
}

SurfaceLight::Place SurfaceLight::place(const Node& node) const {
  const glm::dvec2 middle(1.0 / 3);
  SurfacePoint point{node.triangle, middle, 0, node.back};
  if (node.resolution > 0)  // not on the edge, where other triangles begin
    point.at = glm::mix(glm::dvec2(node.i, node.j) / static_cast<double>(node.resolution), middle,
                        0.05 / node.resolution);
  Place place{surface_.position(point), surface_.normal(point), surface_.face_normal(point)};
  place.from += kLift * place.face;
  return place;
}

SurfaceLight::Node SurfaceLight::coarse(const SurfacePoint& point) const {
  const std::uint32_t triangle = coarse_[point.triangle];
  const int n = resolution(triangle);
  if (n <= kCoarse) return {triangle, point.back, n / 3, n / 3, n};
  const auto nearest = [&](double share, int most) {
    return std::min(static_cast<int>(std::lround(share * n / kCoarse)) * kCoarse, most);
  };
  const int j = nearest(point.at.y, n);
  return {triangle, point.back, nearest(point.at.x, n - j), j, n};
}

glm::vec3 SurfaceLight::at(const SurfacePoint& point) const {
  const int n = resolution(point.triangle);
  const auto node = [&](int i, int j) {
    return at(Node{point.triangle, point.back, i, j, n}, bounces_);
  };
  if (n == 0) return node(0, 0);
  const double x = point.at.x * n, y = point.at.y * n;
  const int j = std::clamp(static_cast<int>(y), 0, n - 1);
  const int i = std::clamp(static_cast<int>(x), 0, n - 1 - j);
  auto u = static_cast<float>(std::clamp(x - i, 0.0, 1.0));
  auto v = static_cast<float>(std::clamp(y - j, 0.0, 1.0));
  if (u + v > 1 && i + j < n - 1)
    return (u + v - 1) * node(i + 1, j + 1) + (1 - u) * node(i, j + 1) + (1 - v) * node(i + 1, j);
  if (u + v > 1) u /= u + v, v = 1 - u;
  return (1 - u - v) * node(i, j) + u * node(i + 1, j) + v * node(i, j + 1);
}

glm::vec3 SurfaceLight::at(const Node& node, unsigned bounces) const {
  const std::uint64_t index = (std::uint64_t{bounces} * 2 + node.back) * first_.back() +
                              first_[node.triangle] + number(node.i, node.j, node.resolution);
  const std::atomic_ref<std::uint64_t> word(known_[index]);
  if (const std::uint64_t value = word.load(std::memory_order_relaxed)) return unpack(value);
  const Place p = place(node);
  const std::uint64_t value = pack(from_lights(p) + from_around(p, bounces));
  word.store(value, std::memory_order_relaxed);
  return unpack(value);  // as any later call returns
}

glm::vec3 SurfaceLight::from_lights(const Place& p) const {
  glm::vec3 light(0);
  const auto add = [&](const glm::dvec3& direction, double distance, const glm::vec3& radiance) {
    const double cosine = glm::dot(p.normal, direction);
    if (cosine > 0 && glm::dot(p.face, direction) > 0 &&
        !surface_.blocked(p.from, direction, distance))
      light += static_cast<float>(cosine) * radiance;
  };
  for (const Ray& ray : far_lights_) add(ray.direction, kInfinity, ray.radiance);
  const glm::dvec3 world = surface_.to_world(p.from);
  for (const PlacedLight& near : near_lights_)
    for (unsigned k = 0; k < kNearSamples; ++k) {
      const auto in = near.incident_light(world, (k + 0.5) / kNearSamples, radical_inverse(k));
      const glm::dvec3 end = surface_.to_local(world + in.distance * in.direction);
      add(in.direction, glm::distance(p.from, end),
          in.irradiance / static_cast<float>(kPi * kNearSamples));
    }
  return light;
}

glm::vec3 SurfaceLight::from_around(const Place& p, unsigned bounces) const {
  glm::vec3 light(0);
  float weights = 0;
  for (const Ray& ray : around_) {
    const auto cosine = static_cast<float>(glm::dot(p.normal, ray.direction));
    if (!(cosine > 0)) continue;
    weights += cosine;
    if (glm::dot(p.face, ray.direction) <= 0) continue;
    if (bounces == 0) {
      if (!surface_.blocked(p.from, ray.direction, kInfinity)) light += cosine * ray.radiance;
      continue;
    }
    const auto hit = surface_.first(p.from, ray.direction, 0, kInfinity);
    const glm::vec4 color = hit ? surface_.color(*hit) : glm::vec4(0);
    if (hit) light += cosine * color.a * glm::vec3(color) * at(coarse(*hit), bounces - 1);
    light += cosine * (1 - color.a) * ray.radiance;
  }
  return weights > 0 ? light / weights : light;
}

}  // namespace slf
