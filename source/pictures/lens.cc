#include <algorithm>
#include <cmath>

#include "slf/pictures.h"

namespace slf {
namespace {

glm::dvec2 distort(const Lens& lens, const glm::dvec2& q) {
  const double r2 = glm::dot(q, q);
  double factor = (1 + r2 * (lens.k[0] + r2 * (lens.k[1] + r2 * (lens.k[2] + r2 * lens.k[3])))) /
                  (1 + r2 * (lens.d[0] + r2 * (lens.d[1] + r2 * lens.d[2])));
  if (lens.omega != 0) {
    const double r = std::sqrt(r2), edge = 2 * std::tan(lens.omega / 2);
    factor *= r > 1e-9 ? std::atan(r * edge) / (r * lens.omega) : edge / lens.omega;
  }
  const double xy = q.x * q.y;
  return {q.x * factor + 2 * lens.p[0] * xy + lens.p[1] * (r2 + 2 * q.x * q.x) + lens.s[0] * r2,
          q.y * factor + 2 * lens.p[1] * xy + lens.p[0] * (r2 + 2 * q.y * q.y) + lens.s[1] * r2};
}

/// The inverse of distort(), by Newton's method with a numeric derivative.
glm::dvec2 undistort(const Lens& lens, const glm::dvec2& target) {
  constexpr double kStep = 1e-6;
  glm::dvec2 q = target;
  for (int round = 0; round < 20; ++round) {
    const glm::dvec2 at = distort(lens, q), error = target - at;
    if (glm::dot(error, error) < 1e-24) break;
    const glm::dvec2 dx = (distort(lens, q + glm::dvec2(kStep, 0)) - at) / kStep;
    const glm::dvec2 dy = (distort(lens, q + glm::dvec2(0, kStep)) - at) / kStep;
    const double det = dx.x * dy.y - dx.y * dy.x;
    if (!(std::abs(det) > 1e-9)) break;
    glm::dvec2 move((error.x * dy.y - error.y * dy.x) / det,
                    (error.y * dx.x - error.x * dx.y) / det);
    // A step beyond the fold of a strong distortion would not come back.
    const double length = glm::length(move);
    if (length > 0.5) move *= 0.5 / length;
    q += move;
  }
  return q;
}

}  // namespace

bool Lens::distorted() const {
  return fisheye || omega != 0 || k != decltype(k){} || d != decltype(d){} || p != decltype(p){} ||
         s != decltype(s){};
}

std::optional<glm::dvec2> Lens::project(const glm::dvec3& v) const {
  glm::dvec2 q;
  if (fisheye) {
    const double r = std::hypot(v.x, v.y);
    const double angle = std::atan2(r, v.z);
    q = r > 0 ? glm::dvec2(v) * (angle / r) : glm::dvec2(0);
  } else {
    if (!(v.z > 0)) return std::nullopt;
    q = glm::dvec2(v) / v.z;
  }
  if (!(glm::dot(q, q) <= max_radius2)) return std::nullopt;
  if (distorted()) q = distort(*this, q);
  return glm::dvec2(fx * q.x + cx, fy * q.y + cy);
}

glm::dvec3 Lens::direction(const glm::dvec2& pixel) const {
  glm::dvec2 q((pixel.x - cx) / fx, (pixel.y - cy) / fy);
  if (distorted()) q = undistort(*this, q);
  if (!fisheye) return {q, 1};
  const double angle = glm::length(q);
  if (angle < 1e-12) return {0, 0, 1};
  return {q * (std::sin(angle) / angle), std::cos(angle)};
}

void Lens::finish() {
  max_radius2 = 0;
  const double w = width, h = height;
  for (const glm::dvec2 pixel :
       {glm::dvec2(0, 0), {w, 0}, {0, h}, {w, h}, {w / 2, 0}, {w / 2, h}, {0, h / 2}, {w, h / 2}}) {
    glm::dvec2 q((pixel.x - cx) / fx, (pixel.y - cy) / fy);
    if (distorted()) q = undistort(*this, q);
    // A little more than the corners, because the caller checks the place in the picture.
    max_radius2 = std::max(max_radius2, 1.05 * glm::dot(q, q));
  }
}

}  // namespace slf
