#include "slf/camera.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "base/try.h"

namespace slf {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr std::uint64_t kMaxPixels = 1ull << 28;

bool finite(const glm::dvec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

}  // namespace

glm::dvec3 any_up(const glm::dvec3& forward) {
  return std::abs(forward.z) < 0.999 * glm::length(forward) ? glm::dvec3(0, 0, 1)
                                                            : glm::dvec3(0, 1, 0);
}

Result<RayGenerator> RayGenerator::make(const Camera& camera) try {
  const auto [eye, look_at, up, fov, width, height] = camera;
  if (width == 0 || height == 0)
    return fail(ErrorCode::usage, "size ", width, "x", height, ": a picture needs pixels");
  if (std::uint64_t{width} * height > kMaxPixels)
    return fail(ErrorCode::usage, "size ", width, "x", height,
                ": at most 2^28 pixels in a picture");
  if (!finite(eye) || !finite(look_at) || !finite(up))
    return fail(ErrorCode::usage, "eye, look-at and up must be finite numbers");
  if (!(fov > 0 && fov < 180))
    return fail(ErrorCode::usage, "field of view ", fov, ": expected degrees between 0 and 180");
  const glm::dvec3 forward = look_at - eye;
  if (!(glm::length(forward) > 0))
    return fail(ErrorCode::usage, "eye and look-at are the same point: there is no view direction");
  const glm::dvec3 right = glm::cross(forward, up);
  if (!(glm::length(right) > 1e-9 * glm::length(forward) * glm::length(up)))
    return fail(ErrorCode::usage, "up points along the view: expected another direction");

  // The picture plane is one unit ahead and has square pixels.
  const double half_height = std::tan(fov * kDegree / 2);
  const double pixel = 2 * half_height / height;
  const glm::dvec3 ahead = glm::normalize(forward);
  const glm::dvec3 x = glm::normalize(right);
  const glm::dvec3 y = glm::cross(x, ahead);
  RayGenerator rays;
  rays.eye_ = eye;
  rays.across_ = x * pixel;
  rays.down_ = -y * pixel;
  rays.corner_ = ahead - rays.across_ * (width / 2.0) - rays.down_ * (height / 2.0);
  return rays;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

double fitted_fov(const Sphere& sphere, double distance, std::uint32_t width,
                  std::uint32_t height) {
  const double half = std::asin(std::min(sphere.radius / distance, 0.999));
  // The sphere must fit the shorter side, but the field of view is vertical.
  const double widen = width < height ? static_cast<double>(height) / width : 1;
  return 2 * std::atan(std::tan(half) * widen) / kDegree;
}

Camera orbit_camera(const Sphere& sphere, double azimuth, double elevation, double distance,
                    std::uint32_t width, std::uint32_t height) {
  const double a = azimuth * kDegree, e = elevation * kDegree;
  const glm::dvec3 toward(std::sin(a) * std::cos(e), -std::cos(a) * std::cos(e), std::sin(e));
  Camera camera;
  camera.look_at = sphere.center;
  camera.eye = sphere.center + distance * sphere.radius * toward;
  camera.up = any_up(toward);
  camera.width = width;
  camera.height = height;
  camera.fov = fitted_fov(sphere, 3 * sphere.radius, width, height);
  return camera;
}

std::vector<Camera> random_cameras(const Sphere& sphere, double distance, std::uint32_t count,
                                   std::uint64_t seed, std::uint32_t width, std::uint32_t height) {
  // The C++ standard specifies the generator but not the distributions, so do not use these.
  std::mt19937_64 random(seed);
  const auto uniform = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  std::vector<Camera> cameras;
  for (std::uint32_t k = 0; k < count; ++k) {
    const double z = 2 * uniform() - 1;
    const double azimuth = 360 * uniform();
    cameras.push_back(
        orbit_camera(sphere, azimuth, std::asin(z) / kDegree, distance, width, height));
    if (distance > 1)
      cameras.back().fov = fitted_fov(sphere, distance * sphere.radius, width, height);
  }
  return cameras;
}

}  // namespace slf
