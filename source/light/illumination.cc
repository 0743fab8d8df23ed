#include "source/light/illumination.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace slf {
namespace {

constexpr double kPi = std::numbers::pi;

double luminance(const glm::vec3& rgb) {  // Rec. 709
  return 0.2126 * rgb.r + 0.7152 * rgb.g + 0.0722 * rgb.b;
}

bool is_light(const glm::vec3& rgb) {
  const auto good = [](float v) { return v >= 0 && std::isfinite(v); };
  return good(rgb.r) && good(rgb.g) && good(rgb.b);
}

}  // namespace

Environment::Environment(const Sky& sky) : height_(64) {
  for (std::size_t row = 0; row < height_; ++row) {
    const auto middle = (static_cast<double>(row) + 0.5) / static_cast<double>(height_);
    const auto z = static_cast<float>(std::cos(kPi * middle));
    texels_.push_back(z > 0 ? glm::mix(sky.horizon, sky.up, z)
                            : glm::mix(sky.horizon, sky.down, -z));
  }
  sum_luminance();
}

Environment::Environment(const Image& picture, float gain) {
  constexpr std::size_t kMaxWidth = 1024;
  const std::size_t factor = (picture.width + kMaxWidth - 1) / kMaxWidth;
  width_ = (picture.width + factor - 1) / factor;
  height_ = (picture.height + factor - 1) / factor;
  texels_.assign(width_ * height_, glm::vec3(0));
  std::vector<float> counts(texels_.size(), 0);
  for (std::size_t k = 0; k < picture.rgba.size(); ++k) {
    const std::size_t x = k % picture.width / factor, y = k / picture.width / factor;
    texels_[y * width_ + x] += gain * glm::vec3(picture.rgba[k]);
    counts[y * width_ + x] += 1;
  }
  for (std::size_t k = 0; k < texels_.size(); ++k) texels_[k] /= counts[k];
  sum_luminance();
}

void Environment::sum_luminance() {
  double sum = 0, max_luminance = 0;
  for (std::size_t k = 0; k < texels_.size(); ++k) {
    max_luminance = std::max(max_luminance, luminance(texels_[k]));
    sum += luminance(texels_[k]) * solid_angle(k / width_);
    cumulative_.push_back(sum);
  }
  peaked_ = max_luminance > 8 * sum / (4 * kPi);  // eight times the mean
}

double Environment::solid_angle(std::size_t row) const {
  const auto height = static_cast<double>(height_);
  const double top = std::cos(kPi * static_cast<double>(row) / height);
  const double bottom = std::cos(kPi * static_cast<double>(row + 1) / height);
  return 2 * kPi / static_cast<double>(width_) * (top - bottom);
}

std::size_t Environment::texel(const glm::dvec3& direction) const {
  const double down = std::acos(std::clamp(direction.z, -1.0, 1.0)) / kPi;
  // The middle column is at -y, those left of it at -x.
  const double right = 0.5 + std::atan2(direction.x, -direction.y) / (2 * kPi);
  const auto place = [](double share, std::size_t count) {
    return std::min(static_cast<std::size_t>(share * static_cast<double>(count)), count - 1);
  };
  return place(down, height_) * width_ + place(right, width_);
}

glm::vec3 Environment::radiance(const glm::dvec3& direction) const {
  return texels_[texel(direction)];
}

double Environment::density(const glm::dvec3& direction) const {
  return luminance(radiance(direction)) / cumulative_.back();
}

Environment::Sample Environment::sample(double choice, double u, double v) const {
  const auto found =
      std::upper_bound(cumulative_.begin(), cumulative_.end(), choice * cumulative_.back());
  const auto k =
      std::min(static_cast<std::size_t>(found - cumulative_.begin()), texels_.size() - 1);
  const std::size_t line = k / width_;
  const auto row = static_cast<double>(line), column = static_cast<double>(k % width_);
  const auto height = static_cast<double>(height_);
  const double z = glm::mix(std::cos(kPi * row / height), std::cos(kPi * (row + 1) / height), u);
  const double angle = 2 * kPi * ((column + v) / static_cast<double>(width_) - 0.5);
  const double r = std::sqrt(std::max(0.0, 1 - z * z));
  return {{r * std::sin(angle), -r * std::cos(angle), z},
          texels_[k],
          luminance(texels_[k]) / cumulative_.back()};
}

PlacedLight::PlacedLight(const Light& light, const Sphere& bounds)
    : center_(bounds.center),
      direction_(glm::normalize(light.direction)),
      tangent_(std::tan(glm::radians(double{light.size}) / 2)),
      distance_(light.distance > 0 ? light.distance * bounds.radius
                                   : std::numeric_limits<double>::infinity()),
      // A white surface that faces the light has the radiance irradiance/π.
      irradiance_(static_cast<float>(kPi) * light.intensity * light.color) {
  const glm::dvec3 other = std::abs(direction_.z) < 0.9 ? glm::dvec3(0, 0, 1) : glm::dvec3(1, 0, 0);
  across_ = glm::normalize(glm::cross(direction_, other));
  up_ = glm::cross(across_, direction_);
}

IncidentLight PlacedLight::incident_light(const glm::dvec3& world, double u, double v) const {
  const double r = tangent_ * std::sqrt(u);
  const glm::dvec3 at =
      direction_ + r * (std::cos(2 * kPi * v) * across_ + std::sin(2 * kPi * v) * up_);
  if (distant()) return {glm::normalize(at), distance_, irradiance_};
  // The disc faces the centre; irradiance falls off by distance and by the angle to the disc.
  const glm::dvec3 to = center_ + distance_ * at - world;
  const double length = glm::length(to);
  const double cosine = std::max(0.0, glm::dot(to, direction_) / length);
  const double ratio = distance_ / length;
  return {to / length, length, static_cast<float>(cosine * ratio * ratio) * irradiance_};
}

std::vector<glm::dvec3> PlacedLight::directions() const {
  // One per degree of the diameter: their shadows then are hardly told apart.
  const double degrees = 2 * glm::degrees(std::atan(tangent_));
  const int count = 1 + static_cast<int>(std::min(degrees, 31.0));
  std::vector<glm::dvec3> directions(static_cast<std::size_t>(count));
  for (int k = 0; k < count; ++k)
    directions[static_cast<std::size_t>(k)] =
        incident_light(center_, count > 1 ? (k + 0.5) / count : 0, k * std::numbers::phi).direction;
  return directions;
}

GridLight PlacedLight::seen_from(const glm::dvec3& origin) const {
  GridLight light{glm::vec4(irradiance_, 0), glm::vec4(direction_, 0)};
  if (distant()) return light;
  light.place = glm::vec4(center_ + distance_ * direction_ - origin, 0);
  light.distance = static_cast<float>(distance_);
  return light;
}

Illumination illuminate(const LightOptions& options, const Sphere& bounds) {
  Illumination all{{},
                   options.environment ? Environment(*options.environment, options.environment_gain)
                                       : Environment(options.rig.sky)};
  for (const Light& light : options.rig.lights)
    if (const PlacedLight placed(light, bounds); !placed.dark()) all.lights.push_back(placed);
  return all;
}

Result<void> check_light(const LightOptions& options) {
  const auto range = [](const char* what, double value, double low, double high) -> Result<void> {
    if (value >= low && value <= high) return {};
    return fail(ErrorCode::usage, what, ' ', value, ": expected ", low, " to ", high);
  };
  const LightRig& rig = options.rig;
  for (std::size_t k = 0; k < rig.lights.size(); ++k) {
    const Light& light = rig.lights[k];
    const auto wrong = [&](const char* what, const char* expected) {
      return fail(ErrorCode::usage, "light rig '", rig.name, "', light ", k, ": ", what,
                  ": expected ", expected);
    };
    const double length = glm::length(light.direction);
    if (!(length > 0) || !std::isfinite(length)) return wrong("direction", "not zero and finite");
    if (!is_light(light.color)) return wrong("color", "three numbers from 0");
    if (!(light.intensity >= 0) || !std::isfinite(light.intensity))
      return wrong("intensity", "a number from 0");
    if (!(light.size >= 0 && light.size <= 120)) return wrong("size", "0 to 120 degrees");
    if (light.distance != 0 && !(light.distance > 1 && light.distance < 1e6))
      return wrong("distance", "0 (infinitely far) or above 1 radius");
  }
  for (const glm::vec3& radiance : {rig.sky.up, rig.sky.horizon, rig.sky.down})
    if (!is_light(radiance))
      return fail(ErrorCode::usage, "light rig '", rig.name,
                  "', sky: expected colours of numbers from 0");
  if (options.environment) {
    const Image& picture = *options.environment;
    for (std::size_t k = 0; k < picture.rgba.size(); ++k)
      if (!is_light(glm::vec3(picture.rgba[k])))
        return fail(ErrorCode::usage, "environment: the radiance at pixel ", k % picture.width, ",",
                    k / picture.width, " is negative or not finite");
    if (picture.rgba.empty()) return fail(ErrorCode::usage, "environment: no pixels");
  }
  for (const auto& ok : {range("environment gain", options.environment_gain, 0, 1e6),
                         range("light samples", options.samples, 1, 65536),
                         range("light bounces", options.bounces, 0, 1000),
                         range("light spacing", options.spacing, 0.5, 16),
                         range("light memory", static_cast<double>(options.memory), 1 << 20, 1e15),
                         range("exposure", options.tone.exposure, -20, 20)})
    if (!ok) return ok;
  return {};
}

}  // namespace slf
