// Camera: the viewpoint and the ray through each pixel; CameraPath: a camera that moves.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "slf/error.h"
#include "slf/shape.h"

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

/// Passes through keys, smoothly (cubic Hermite, Catmull-Rom tangents); stands still before the
/// first and behind the last. Thread-safety: immutable.
class CameraPath {
 public:
  /// Turns around the sphere's centre at a steady pace: `turns` times 360 degrees of azimuth,
  /// starting from these angles in degrees, at this distance in sphere radii. usage: not finite, no
  /// time, or a distance not above 0.
  [[nodiscard]] static Result<CameraPath> orbit(const Sphere& sphere, double azimuth,
                                                double elevation, double distance, double turns,
                                                double seconds);

  /// Reads keyframes (untrusted):
  ///   {"keys": [{"at": 0, "orbit": [30, 20, 3]},
  ///             {"at": 4, "eye": [0, -300, 80], "look_at": [0, 0, 20], "fov": 30}, ...]}
  /// At least two; `at` is in seconds, ascending, and the path begins at the first. A key has an
  /// orbit (azimuth, elevation, distance as above; azimuths beyond 360 go round again) or an eye in
  /// world units, and may have look_at (default: the sphere's centre) and fov (default: the sphere
  /// fits). bad_file: anything else; the message says `name`, key and cure.
  [[nodiscard]] static Result<CameraPath> parse(std::string_view json, const std::string& name,
                                                const Sphere& sphere);

  /// The same from a file. io: cannot read.
  [[nodiscard]] static Result<CameraPath> read(const std::string& path, const Sphere& sphere);

  [[nodiscard]] double seconds() const { return keys_.back().at; }
  /// up is any_up() of the view.
  [[nodiscard]] Camera at(double seconds, std::uint32_t width, std::uint32_t height) const;

 private:
  struct Key {
    double at = 0;
    /// Azimuth and elevation in degrees, distance in radii, look_at, fov in degrees (0: fitted).
    std::array<double, 7> place{};
  };
  CameraPath(const Sphere& sphere, std::vector<Key> keys)
      : sphere_(sphere), keys_(std::move(keys)) {}

  Sphere sphere_;
  std::vector<Key> keys_;
};

}  // namespace slf
