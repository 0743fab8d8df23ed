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

/// A pinhole camera with square pixels.
struct Camera {
  glm::dvec3 eye{0.0};      ///< world
  glm::dvec3 look_at{0.0};  ///< world
  glm::dvec3 up{0, 0, 1};   ///< world direction; need not be perpendicular to the view
  double fov = 40;          ///< vertical field of view in degrees, above 0 and below 180
  /// Size of the picture in pixels; width × height is at most 2^28.
  std::uint32_t width = 512;
  std::uint32_t height = 512;

  bool operator==(const Camera&) const = default;
};

/// A pixel's ray, from the eye through the pixel's centre. The direction need not have unit length.
struct PixelRay {
  glm::dvec3 origin;
  glm::dvec3 direction;
};

/// A valid camera, and the rays of its pixels.
class RayGenerator {
 public:
  /// usage: a number is not finite, eye and look_at are equal, up is parallel to the view, the
  /// field of view is outside (0, 180), or there are no pixels or more than 2^28. The message says
  /// which, and what is valid.
  [[nodiscard]] static Result<RayGenerator> make(const Camera& camera);

  /// The ray of a pixel, x from the left, y from the top. REQUIRES: it is inside the picture.
  [[nodiscard]] PixelRay ray(std::uint32_t x, std::uint32_t y) const {
    return {eye_, corner_ + (x + 0.5) * across_ + (y + 0.5) * down_};
  }
  [[nodiscard]] const glm::dvec3& eye() const { return eye_; }
  /// Direction of the ray through the picture's upper left corner.
  [[nodiscard]] const glm::dvec3& corner() const { return corner_; }
  /// Differences of direction from one pixel to the next, to the right and down.
  [[nodiscard]] const glm::dvec3& across() const { return across_; }
  [[nodiscard]] const glm::dvec3& down() const { return down_; }

 private:
  glm::dvec3 eye_, corner_, across_, down_;
};

/// An up direction for views along `forward`: +z, or +y if `forward` is nearly parallel to z.
[[nodiscard]] glm::dvec3 any_up(const glm::dvec3& forward);

/// The vertical field of view, in degrees, at which the whole sphere fits a picture of these
/// proportions. `distance` is from the eye to the centre, in world units.
/// REQUIRES: it is above the radius.
[[nodiscard]] double fitted_fov(const Sphere& sphere, double distance, std::uint32_t width,
                                std::uint32_t height);

/// Distances of orbits are above 0 and at most this, in sphere radii.
constexpr double kMaxOrbit = 1e6;

/// A camera that looks at the centre, from an azimuth and elevation in degrees and a distance in
/// sphere radii. Azimuth 0 is the front (-y, anterior), 90 the patient's left (+x). Elevation 90 is
/// above (+z). The field of view is fitted_fov() for a distance of 3, whatever the distance is, so
/// that what is nearer appears larger, as in the page.
[[nodiscard]] Camera orbit_camera(const Sphere& sphere, double azimuth, double elevation,
                                  double distance, std::uint32_t width, std::uint32_t height);

/// `count` cameras at `distance` radii, in directions uniformly distributed over the sphere, such
/// that the sphere fits the picture. The same seed gives the same cameras on every machine.
[[nodiscard]] std::vector<Camera> random_cameras(const Sphere& sphere, double distance,
                                                 std::uint32_t count, std::uint64_t seed,
                                                 std::uint32_t width, std::uint32_t height);

/// A smooth path through keyframes (cubic Hermite with Catmull-Rom tangents). The camera stands
/// still before the first keyframe and after the last. Thread-safety: immutable.
class CameraPath {
 public:
  /// An orbit around the sphere's centre at constant speed: from `azimuth`, `turns` times 360
  /// degrees, at a constant elevation in degrees and distance in sphere radii. usage: a number is
  /// not finite, the distance is not above 0, or the time is not above 0 and at most a day.
  [[nodiscard]] static Result<CameraPath> orbit(const Sphere& sphere, double azimuth,
                                                double elevation, double distance, double turns,
                                                double seconds);

  /// Reads keyframes (untrusted):
  ///   {"keys": [{"at": 0, "orbit": [30, 20, 3]},
  ///             {"at": 4, "eye": [0, -300, 80], "look_at": [0, 0, 20], "fov": 30}, ...]}
  /// There are 2 to 10,000 keys. `at` is in seconds, 0 to a day, and ascends; the path begins at
  /// that of the first key. Each key has an orbit (azimuth, elevation, distance as above; azimuths
  /// may exceed 360) or an eye in world units. It may have look_at (default: the sphere's centre)
  /// and fov (default: that of orbit_camera()). bad_file: anything else; the message names
  /// `name`, the key and what was expected.
  [[nodiscard]] static Result<CameraPath> parse(std::string_view json, const std::string& name,
                                                const Sphere& sphere);

  /// The same from a file of at most 16 MiB. io: it cannot be read. unsupported: it is longer.
  [[nodiscard]] static Result<CameraPath> read(const std::string& path, const Sphere& sphere);

  /// Duration of the path.
  [[nodiscard]] double seconds() const { return keys_.back().at; }
  /// The camera `seconds` after the path begins. Its `up` is any_up() of the view direction.
  [[nodiscard]] Camera at(double seconds, std::uint32_t width, std::uint32_t height) const;

 private:
  struct Key {
    double at = 0;
    /// Azimuth and elevation in degrees, distance in radii, look_at, fov in degrees or 0.
    std::array<double, 7> place{};
  };
  CameraPath(const Sphere& sphere, std::vector<Key> keys)
      : sphere_(sphere), keys_(std::move(keys)) {}

  Sphere sphere_;
  std::vector<Key> keys_;
};

}  // namespace slf
