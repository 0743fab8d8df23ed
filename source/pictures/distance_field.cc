#include "source/pictures/distance_field.h"

#include <algorithm>

namespace slf {

DistanceField::DistanceField(const Sphere& sphere, std::uint32_t side)
    : side_(side),
      blocks_((side + kBlock - 1) / kBlock),
      voxel_(2 * sphere.radius / side),
      origin_(sphere.center - sphere.radius + 0.5 * voxel_),
      values_(std::size_t{side} * side * side, 127),
      busy_(std::size_t{blocks_} * blocks_ * blocks_, 0) {}

void DistanceField::finish() {
  std::ranges::fill(busy_, std::uint8_t{0});
  for (std::uint32_t z = 0; z < side_; ++z)
    for (std::uint32_t y = 0; y < side_; ++y)
      for (std::uint32_t x = 0; x < side_; ++x) {
        if (values_[index(x, y, z)] == 127) continue;
        // Interpolation between voxels reaches one voxel into the blocks around.
        const auto low = [](std::uint32_t v) { return (v == 0 ? 0 : v - 1) / kBlock; };
        const auto high = [&](std::uint32_t v) { return std::min(v + 1, side_ - 1) / kBlock; };
        for (std::uint32_t c = low(z); c <= high(z); ++c)
          for (std::uint32_t b = low(y); b <= high(y); ++b)
            for (std::uint32_t a = low(x); a <= high(x); ++a)
              busy_[(std::size_t{c} * blocks_ + b) * blocks_ + a] = 1;
      }
}

Sphere DistanceField::bounds() const {
  glm::dvec3 low(1e300), high(-1e300);
  for (std::uint32_t z = 0; z < side_; ++z)
    for (std::uint32_t y = 0; y < side_; ++y)
      for (std::uint32_t x = 0; x < side_; ++x)
        if (values_[index(x, y, z)] < 0) {
          low = glm::min(low, center(x, y, z));
          high = glm::max(high, center(x, y, z));
        }
  if (low.x > high.x) return {glm::dvec3(0), 0};
  Sphere sphere{(low + high) / 2.0, 0};
  for (std::uint32_t z = 0; z < side_; ++z)
    for (std::uint32_t y = 0; y < side_; ++y)
      for (std::uint32_t x = 0; x < side_; ++x)
        if (values_[index(x, y, z)] < 0)
          sphere.radius = std::max(sphere.radius, glm::distance(center(x, y, z), sphere.center));
  sphere.radius += 1.5 * voxel_;
  return sphere;
}

double DistanceField::at(const glm::dvec3& grid) const {
  const double last = side_ - 1.001;
  const glm::dvec3 g = glm::clamp(grid, 0.0, last);
  const auto x = static_cast<std::size_t>(g.x), y = static_cast<std::size_t>(g.y),
             z = static_cast<std::size_t>(g.z);
  const double fx = g.x - static_cast<double>(x), fy = g.y - static_cast<double>(y),
               fz = g.z - static_cast<double>(z);
  const std::int8_t* v = &values_[(z * side_ + y) * side_ + x];
  const std::size_t row = side_, slice = row * side_;
  const auto along = [&](std::size_t k) { return v[k] + fx * (v[k + 1] - v[k]); };
  const double front = along(0) + fy * (along(row) - along(0));
  const double back = along(slice) + fy * (along(slice + row) - along(slice));
  return (front + fz * (back - front)) / 127;
}

DistanceField::Meeting DistanceField::meet(const glm::dvec3& from, const glm::dvec3& to) const {
  constexpr double kNear = 0.6;  // of the values of a ray that passes the surface by
  constexpr double kStep = 0.5;  // voxels
  const glm::dvec3 start = (from - origin_) / voxel_, way = (to - from) / voxel_;
  const double length = glm::length(way);
  if (!(length > 0)) return {};
  // The part in the cube.
  double t0 = 0, t1 = 1;
  for (int axis = 0; axis < 3; ++axis) {
    const double a = (-0.5 - start[axis]) / way[axis], b = (side_ - 0.5 - start[axis]) / way[axis];
    if (way[axis] != 0) {
      t0 = std::max(t0, std::min(a, b));
      t1 = std::min(t1, std::max(a, b));
    } else if (start[axis] < -0.5 || start[axis] > side_ - 0.5) {
      return {};
    }
  }
  const double step = kStep / length;
  double least = 1, least_t = 0, before = 1, before_t = t0;
  for (double t = t0; t < t1;) {
    const glm::dvec3 g = start + t * way;
    const glm::dvec3 held = glm::clamp(g, 0.0, side_ - 1.0);
    const auto bx = static_cast<std::uint32_t>(held.x) / kBlock,
               by = static_cast<std::uint32_t>(held.y) / kBlock,
               bz = static_cast<std::uint32_t>(held.z) / kBlock;
    if (busy_[(std::size_t{bz} * blocks_ + by) * blocks_ + bx] == 0) {
      // Leaps to where the ray leaves the block.
      double leave = t1;
      const glm::dvec3 low = glm::dvec3(bx, by, bz) * double{kBlock};
      for (int axis = 0; axis < 3; ++axis) {
        // Blocks at the faces reach to the end of the cube.
        if (way[axis] > 0 && low[axis] + kBlock < side_)
          leave = std::min(leave, (low[axis] + kBlock - start[axis]) / way[axis]);
        if (way[axis] < 0 && low[axis] > 0)
          leave = std::min(leave, (low[axis] - start[axis]) / way[axis]);
      }
      before = 1;
      t = std::max(leave, t) + 1e-3 * step;
      before_t = t;
      continue;
    }
    const double value = at(g);
    if (value < 0) {
      const double share = before > value ? before / (before - value) : 0;
      return {Meeting::Kind::hit, before_t + share * (t - before_t)};
    }
    if (value < least) least = value, least_t = t;
    before = value;
    before_t = t;
    t += step;
  }
  if (least < kNear) return {Meeting::Kind::near, least_t};
  return {};
}

std::optional<double> DistanceField::first_hit(const Sphere& sphere, const glm::dvec3& eye,
                                               const glm::dvec3& way) const {
  const Chord chord = intersect(sphere, eye, way);
  if (!chord.hit || chord.leave <= 0) return std::nullopt;
  const double enter = std::max(chord.enter, 0.0), leave = chord.leave;
  const Meeting meeting = meet(eye + enter * way, eye + leave * way);
  if (meeting.kind != Meeting::Kind::hit) return std::nullopt;
  return enter + meeting.t * (leave - enter);
}

}  // namespace slf
