// CameraPath: a camera on the move, for players.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "slf/camera.h"
#include "slf/error.h"

namespace slf {

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
