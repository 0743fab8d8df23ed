// The lights and the surroundings of a scene, in the form that light transport needs: as samples.
// Internal.
#pragma once

#include <cmath>
#include <glm/glm.hpp>
#include <limits>
#include <vector>

#include "slf/light.h"
#include "slf/shape.h"
#include "source/light/light_grid.h"

namespace slf {

/// Radiance from infinitely far in all directions: constant on each texel of a latitude-longitude
/// picture, so that its density is exact. Thread-safety: immutable.
class Environment {
 public:
  explicit Environment(const Sky& sky);
  /// Pictures wider than 1024 texels are averaged down. REQUIRES: finite pixels that are not
  /// negative.
  Environment(const Image& picture, float gain);

  [[nodiscard]] glm::vec3 radiance(const glm::dvec3& direction) const;

  struct Sample {
    glm::dvec3 direction;
    glm::vec3 radiance;
    double density;  // per steradian
  };
  /// A direction with a density that is proportional to luminance.
  [[nodiscard]] Sample sample(double choice, double u, double v) const;
  [[nodiscard]] double density(const glm::dvec3& direction) const;

  /// Whether there is no light at all.
  [[nodiscard]] bool dark() const { return !(cumulative_.back() > 0); }
  /// Whether most light comes from few directions, so that sample() is needed to find them.
  [[nodiscard]] bool peaked() const { return peaked_; }

 private:
  void sum_luminance();
  [[nodiscard]] std::size_t texel(const glm::dvec3& direction) const;
  [[nodiscard]] double solid_angle(std::size_t row) const;

  std::size_t width_ = 1, height_ = 1;
  std::vector<glm::vec3> texels_;
  std::vector<double> cumulative_;  // luminance × solid angle of each texel and all before it
  bool peaked_ = false;
};

/// The light that one of the lights sends to a point.
struct IncidentLight {
  glm::dvec3 direction;  // unit, world, towards the light
  double distance;       // world units; infinity: a distant light
  glm::vec3 irradiance;  // on a surface that faces the direction, if nothing is in between
};

/// A Light in world coordinates.
class PlacedLight {
 public:
  PlacedLight(const Light& light, const Sphere& bounds);
  /// The light from a uniform point of the disc; u, v in [0, 1).
  [[nodiscard]] IncidentLight incident_light(const glm::dvec3& world, double u, double v) const;
  /// Whether its rays from one point of the disc are parallel.
  [[nodiscard]] bool distant() const { return std::isinf(distance_); }
  /// Directions to points that cover the disc evenly, more of them the larger it is.
  /// REQUIRES: distant().
  [[nodiscard]] std::vector<glm::dvec3> directions() const;
  /// Its middle, as rays need it.
  [[nodiscard]] GridLight seen_from(const glm::dvec3& origin) const;
  [[nodiscard]] bool dark() const { return !(irradiance_.r + irradiance_.g + irradiance_.b > 0); }

 private:
  glm::dvec3 center_;     // of the bounds
  glm::dvec3 direction_;  // unit
  glm::dvec3 across_, up_;
  double tangent_;   // of half the apparent diameter
  double distance_;  // world units, or infinity
  glm::vec3 irradiance_;
};

struct Illumination {
  std::vector<PlacedLight> lights;
  Environment environment;
};
[[nodiscard]] Illumination illuminate(const LightOptions& options, const Sphere& bounds);

/// usage: a number out of range, or a pixel of the environment that is not finite or negative.
[[nodiscard]] Result<void> check_light(const LightOptions& options);

}  // namespace slf
