#include "source/transfer/transfer_color.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "slf/tone.h"

namespace slf::transfer_color {

namespace {

const glm::dvec3 kWhite{0.9505, 1.0, 1.089};  // D65, as VTK rounds it

// Magnitude, saturation angle, hue angle: CIELAB in polar form (Moreland 2009, "Diverging Color
// Maps for Scientific Visualization").
struct Msh {
  double m, s, h;
};

Msh lab_to_msh(const glm::dvec3& lab) {
  const double m = glm::length(lab);
  const double s = m > 0.001 ? std::acos(lab.x / m) : 0;
  return {m, s, s > 0.001 ? std::atan2(lab.z, lab.y) : 0};
}

glm::dvec3 msh_to_lab(const Msh& c) {
  return {c.m * std::cos(c.s), c.m * std::sin(c.s) * std::cos(c.h),
          c.m * std::sin(c.s) * std::sin(c.h)};
}

double angle_between(double a, double b) {
  const double difference = std::fmod(std::abs(a - b), 2 * std::numbers::pi);
  return std::min(difference, 2 * std::numbers::pi - difference);
}

/// A hue for an unsaturated colour, such that the path to `saturated` looks even.
double adjust_hue(const Msh& saturated, double unsaturated_m) {
  if (saturated.m >= unsaturated_m - 0.1) return saturated.h;
  const double spin = saturated.s *
                      std::sqrt(unsaturated_m * unsaturated_m - saturated.m * saturated.m) /
                      (saturated.m * std::sin(saturated.s));
  return saturated.h > -0.3 * std::numbers::pi ? saturated.h + spin : saturated.h - spin;
}

glm::dvec3 interpolate_diverging(const glm::dvec3& rgb_a, const glm::dvec3& rgb_b, double s) {
  Msh a = lab_to_msh(rgb_to_lab(rgb_a));
  Msh b = lab_to_msh(rgb_to_lab(rgb_b));
  constexpr double kSaturated = 0.05;
  // Between two distinct saturated colours, pass through white.
  if (a.s > kSaturated && b.s > kSaturated && angle_between(a.h, b.h) > 0.33 * std::numbers::pi) {
    const Msh white{std::max({a.m, b.m, 88.0}), 0, 0};
    if (s < 0.5) {
      b = white;
      s = 2 * s;
    } else {
      a = white;
      s = 2 * s - 1;
    }
  }
  if (a.s < kSaturated && b.s > kSaturated)
    a.h = adjust_hue(b, a.m);
  else if (b.s < kSaturated && a.s > kSaturated)
    b.h = adjust_hue(a, b.m);
  const auto mix = [s](double x, double y) { return (1 - s) * x + s * y; };
  return lab_to_rgb(msh_to_lab({mix(a.m, b.m), mix(a.s, b.s), mix(a.h, b.h)}));
}

glm::dvec3 interpolate_hsv(const glm::dvec3& rgb_a, const glm::dvec3& rgb_b, double s) {
  glm::dvec3 a = rgb_to_hsv(rgb_a), b = rgb_to_hsv(rgb_b);
  // Take the shorter way around the circle of hues.
  if (a.x - b.x > 0.5)
    a.x -= 1;
  else if (b.x - a.x > 0.5)
    b.x -= 1;
  glm::dvec3 hsv = glm::mix(a, b, s);
  if (hsv.x < 0) hsv.x += 1;
  return hsv_to_rgb(hsv);
}

}  // namespace

glm::dvec3 rgb_to_hsv(const glm::dvec3& rgb) {
  const double max = std::max({rgb.x, rgb.y, rgb.z});
  const double range = max - std::min({rgb.x, rgb.y, rgb.z});
  if (!(max > 0) || !(range > 0)) return {0, 0, std::max(max, 0.0)};
  double hue = max == rgb.x   ? (rgb.y - rgb.z) / range
               : max == rgb.y ? 2 + (rgb.z - rgb.x) / range
                              : 4 + (rgb.x - rgb.y) / range;
  hue /= 6;
  return {hue < 0 ? hue + 1 : hue, range / max, max};
}

glm::dvec3 hsv_to_rgb(const glm::dvec3& hsv) {
  const auto channel = [&](double offset) {
    const double k = std::fmod(offset + hsv.x * 6, 6.0);
    return hsv.z - hsv.z * hsv.y * std::clamp(std::min(k, 4 - k), 0.0, 1.0);
  };
  return {channel(5), channel(3), channel(1)};
}

glm::dvec3 rgb_to_lab(const glm::dvec3& rgb) {
  const glm::dvec3 c{linear_from_srgb(rgb.x), linear_from_srgb(rgb.y), linear_from_srgb(rgb.z)};
  const glm::dvec3 xyz = glm::dvec3{0.4124 * c.x + 0.3576 * c.y + 0.1805 * c.z,
                                    0.2126 * c.x + 0.7152 * c.y + 0.0722 * c.z,
                                    0.0193 * c.x + 0.1192 * c.y + 0.9505 * c.z} /
                         kWhite;
  const auto f = [](double v) { return v > 0.008856 ? std::cbrt(v) : 7.787 * v + 16.0 / 116; };
  const glm::dvec3 v{f(xyz.x), f(xyz.y), f(xyz.z)};
  return {116 * v.y - 16, 500 * (v.x - v.y), 200 * (v.y - v.z)};
}

glm::dvec3 lab_to_rgb(const glm::dvec3& lab) {
  const double y = (lab.x + 16) / 116;
  const auto f = [](double v) {
    const double cube = v * v * v;
    return cube > 0.008856 ? cube : (v - 16.0 / 116) / 7.787;
  };
  const glm::dvec3 xyz = glm::dvec3{f(lab.y / 500 + y), f(y), f(y - lab.z / 200)} * kWhite;
  glm::dvec3 rgb{srgb_from_linear(3.2406 * xyz.x - 1.5372 * xyz.y - 0.4986 * xyz.z),
                 srgb_from_linear(-0.9689 * xyz.x + 1.8758 * xyz.y + 0.0415 * xyz.z),
                 srgb_from_linear(0.0557 * xyz.x - 0.2040 * xyz.y + 1.0570 * xyz.z)};
  // Out of gamut: like VTK, scale down colours that are too bright and clamp negative channels.
  const double max = std::max({rgb.x, rgb.y, rgb.z});
  if (max > 1) rgb /= max;
  return glm::max(rgb, glm::dvec3(0.0));
}

glm::dvec3 interpolate(TransferFunction::Space space, const glm::dvec3& a, const glm::dvec3& b,
                       double s) {
  using Space = TransferFunction::Space;
  switch (space) {
    case Space::rgb:
      return glm::mix(a, b, s);
    case Space::hsv:
      return interpolate_hsv(a, b, s);
    case Space::lab:
      return lab_to_rgb(glm::mix(rgb_to_lab(a), rgb_to_lab(b), s));
    case Space::diverging:
      return interpolate_diverging(a, b, s);
    case Space::step:
      break;
  }
  return b;
}

}  // namespace slf::transfer_color
