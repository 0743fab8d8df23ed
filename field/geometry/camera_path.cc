#include "slf/camera.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>

#include "base/file.h"
#include "base/try.h"

namespace slf {
namespace {

constexpr double kMaxSeconds = 86400;
constexpr std::size_t kMaxKeys = 10000;
constexpr std::uint64_t kMaxBytes = 16 << 20;

/// An array of `count` finite numbers.
template <std::size_t kCount>
std::optional<std::array<double, kCount>> numbers_of(const nlohmann::json& json) {
  std::array<double, kCount> numbers{};
  if (!json.is_array() || json.size() != kCount) return std::nullopt;
  for (std::size_t k = 0; k < kCount; ++k) {
    if (!json[k].is_number() || !std::isfinite(json[k].get<double>())) return std::nullopt;
    numbers[k] = json[k].get<double>();
  }
  return numbers;
}

/// A member that is a number; NaN if it is missing or another type.
double number_of(const nlohmann::json& json, const char* key) {
  return json.contains(key) && json[key].is_number() ? json[key].get<double>()
                                                     : std::numeric_limits<double>::quiet_NaN();
}

/// Azimuth, elevation and distance of an eye, in the units of orbit_camera().
std::array<double, 3> orbit_of(const Sphere& sphere, const glm::dvec3& eye) {
  const glm::dvec3 d = eye - sphere.center;
  const double far = glm::length(d);
  return {glm::degrees(std::atan2(d.x, -d.y)),
          glm::degrees(std::asin(std::clamp(d.z / far, -1.0, 1.0))), far / sphere.radius};
}

/// Cubic Hermite between b and c at u in [0, 1], with slopes per unit of u.
double hermite(double b, double c, double slope_b, double slope_c, double u) {
  const double u2 = u * u, u3 = u2 * u;
  return (2 * u3 - 3 * u2 + 1) * b + (u3 - 2 * u2 + u) * slope_b + (3 * u2 - 2 * u3) * c +
         (u3 - u2) * slope_c;
}

}  // namespace

Result<CameraPath> CameraPath::orbit(const Sphere& sphere, double azimuth, double elevation,
                                     double distance, double turns, double seconds) try {
  for (const double value : {azimuth, elevation, distance, turns, seconds})
    if (!std::isfinite(value)) return fail(ErrorCode::usage, "orbit: expected finite numbers");
  if (!(distance > 0))
    return fail(ErrorCode::usage, "orbit: distance ", distance, ": expected > 0");
  if (!(seconds > 0 && seconds <= kMaxSeconds))
    return fail(ErrorCode::usage, "orbit of ", seconds, " s: expected above 0, at most a day");
  const glm::dvec3& c = sphere.center;
  return CameraPath(sphere,
                    {{0, {azimuth, elevation, distance, c.x, c.y, c.z, 0}},
                     {seconds, {azimuth + 360 * turns, elevation, distance, c.x, c.y, c.z, 0}}});
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<CameraPath> CameraPath::parse(std::string_view json, const std::string& name,
                                     const Sphere& sphere) try {
  const auto root = nlohmann::json::parse(json, nullptr, false);
  if (!root.is_object() || !root.contains("keys") || !root["keys"].is_array())
    return bad_file(name, "expected JSON with an array \"keys\"");
  const nlohmann::json& keys = root["keys"];
  if (keys.size() < 2 || keys.size() > kMaxKeys)
    return bad_file(name, keys.size(), " keys; expected 2 to ", kMaxKeys);

  std::vector<Key> path;
  for (std::size_t k = 0; k < keys.size(); ++k) {
    const nlohmann::json& from = keys[k];
    const auto bad = [&](const char* what) { return bad_file(name, "key ", k, ": ", what); };
    if (!from.is_object()) return bad("expected an object");
    Key key;
    const double at = number_of(from, "at");
    if (!(at >= 0 && at <= kMaxSeconds)) return bad("expected \"at\", seconds from 0 to a day");
    key.at = at;
    if (!path.empty() && !(key.at > path.back().at))
      return bad("\"at\" must be later than that of the key before");

    if (from.contains("orbit") == from.contains("eye"))
      return bad("expected \"orbit\" or \"eye\", and not both");
    auto place = numbers_of<3>(from.contains("orbit") ? from["orbit"] : from["eye"]);
    if (!place) return bad("expected three numbers in \"orbit\" or \"eye\"");
    if (from.contains("eye")) {
      const glm::dvec3 eye((*place)[0], (*place)[1], (*place)[2]);
      if (eye == sphere.center) return bad("\"eye\" is at the centre; move it outside");
      place = orbit_of(sphere, eye);
      // Choose the turn of the azimuth that is closest to the previous key's.
      if (!path.empty())
        (*place)[0] += 360 * std::round((path.back().place[0] - (*place)[0]) / 360);
    }
    if (!((*place)[2] > 0)) return bad("the distance must be above 0");
    std::copy(place->begin(), place->end(), key.place.begin());

    const glm::dvec3& c = sphere.center;
    const auto look_at = from.contains("look_at") ? numbers_of<3>(from["look_at"])
                                                  : std::optional(std::array{c.x, c.y, c.z});
    if (!look_at) return bad("expected three numbers in \"look_at\"");
    std::copy(look_at->begin(), look_at->end(), key.place.begin() + 3);
    if (from.contains("fov")) {
      const double fov = number_of(from, "fov");
      if (!(fov > 0 && fov < 180)) return bad("expected \"fov\" in degrees, above 0 and below 180");
      key.place[6] = fov;
    }
    path.push_back(key);
  }
  const double begin = path.front().at;
  for (Key& key : path) key.at -= begin;
  return CameraPath(sphere, std::move(path));
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<CameraPath> CameraPath::read(const std::string& path, const Sphere& sphere) try {
  const auto bytes = SLF_TRY(read_file(path, kMaxBytes));
  return parse({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, path, sphere);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Camera CameraPath::at(double seconds, std::uint32_t width, std::uint32_t height) const {
  const double t = std::clamp(seconds, 0.0, this->seconds());
  std::size_t next = 1;
  while (next + 1 < keys_.size() && keys_[next].at < t) ++next;
  const Key &b = keys_[next - 1], &c = keys_[next];
  const double span = c.at - b.at, u = (t - b.at) / span;
  std::array<double, 7> place{};
  for (std::size_t k = 0; k < place.size(); ++k) {
    const auto slope = [&](std::size_t key) {
      const Key& before = keys_[key == 0 ? 0 : key - 1];
      const Key& after = keys_[std::min(key + 1, keys_.size() - 1)];
      return (after.place[k] - before.place[k]) / (after.at - before.at) * span;
    };
    place[k] = hermite(b.place[k], c.place[k], slope(next - 1), slope(next), u);
  }
  place[1] = std::clamp(place[1], -90.0, 90.0);
  place[2] = std::max(place[2], 1e-3);
  Camera camera = orbit_camera(sphere_, place[0], place[1], place[2], width, height);
  const auto fov = [&](const Key& key) { return key.place[6] > 0 ? key.place[6] : camera.fov; };
  if (b.place[6] > 0 || c.place[6] > 0) camera.fov = hermite(fov(b), fov(c), 0, 0, u);
  camera.look_at = {place[3], place[4], place[5]};
  camera.up = any_up(camera.look_at - camera.eye);
  return camera;
}

}  // namespace slf
