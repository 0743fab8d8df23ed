// Camera: where one looks from, and the ray through each pixel.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "slf/error.h"
#include "slf/sphere.h"

namespace slf {

struct Camera {
  glm::dvec3 eye{0.0};      ///< world
  glm::dvec3 look_at{0.0};  ///< world
  glm::dvec3 up{0, 0, 1};   ///< world direction; need not be perpendicular to the view
  double fov = 40;          ///< vertical field of view in degrees
  std::uint32_t width = 512;
  std::uint32_t height = 512;
};

/// A pixel's ray: from the eye, through the pixel's centre; not of unit length.
struct PixelRay {
  glm::dvec3 origin;
  glm::dvec3 direction;
};

/// A checked camera, ready to give rays.
class RayGenerator {
 public:
  /// usage: not finite, looking nowhere, up along the view, field of view outside (0, 180), no
  /// pixels or more than 2^28 of them; the message says which and what would do.
  [[nodiscard]] static Result<RayGenerator> make(const Camera& camera);

  /// x from the left, y from the top. REQUIRES: inside the picture.
  [[nodiscard]] PixelRay ray(std::uint32_t x, std::uint32_t y) const {
    return {eye_, corner_ + (x + 0.5) * across_ + (y + 0.5) * down_};
  }
  [[nodiscard]] const glm::dvec3& eye() const { return eye_; }
  [[nodiscard]] const glm::dvec3& corner() const { return corner_; }
  [[nodiscard]] const glm::dvec3& across() const { return across_; }
  [[nodiscard]] const glm::dvec3& down() const { return down_; }

 private:
  glm::dvec3 eye_, corner_, across_, down_;
};

/// A direction to be up in pictures that look along `forward`: +z, unless that is too close to it.
[[nodiscard]] glm::dvec3 any_up(const glm::dvec3& forward);

/// Field of view, in degrees, that fits the whole sphere in a picture of this shape seen from
/// `distance` (world units, above the radius) from its centre.
[[nodiscard]] double fitted_fov(const Sphere& sphere, double distance, std::uint32_t width,
                                std::uint32_t height);

/// The camera that looks at the centre from azimuth and elevation in degrees and a distance in
/// sphere radii. Azimuth 0 is the front (-y, anterior), 90 the patient's left (+x); elevation 90
/// is above (+z). The sphere fits the picture when the distance is above 1.
[[nodiscard]] Camera orbit_camera(const Sphere& sphere, double azimuth, double elevation,
                                  double distance, std::uint32_t width, std::uint32_t height);

/// `count` cameras in directions uniform on the sphere, the same for the same seed everywhere:
/// eye at `distance` radii, the sphere fitted.
[[nodiscard]] std::vector<Camera> random_cameras(const Sphere& sphere, double distance,
                                                 std::uint32_t count, std::uint64_t seed,
                                                 std::uint32_t width, std::uint32_t height);

}  // namespace slf
