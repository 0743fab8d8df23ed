#include "field/block_renderer.h"

#include <algorithm>
#include <cmath>

namespace slf {
namespace {

constexpr float kFaint = 1.f / 255;  // below this opacity a depth is not worth following
constexpr int kDepthPasses = 2;

/// Nearest instead of interpolated: all weight to the greatest.
void keep_greatest(std::array<double, 3>& weights) {
  const auto greatest = std::max_element(weights.begin(), weights.end()) - weights.begin();
  weights = {};
  weights[static_cast<std::size_t>(greatest)] = 1;
}

void find_corners(const LevelGeometry& geometry, bool nearest, Pixel& pixel) {
  Cell cell = locate(pixel.ray.enter, geometry.entry_resolution());
  if (nearest) keep_greatest(cell.weights);
  const auto points = cell.corners();
  for (std::size_t c = 0; c < 3; ++c) {
    EntryCorner& corner = pixel.corners[c];
    corner.row = geometry.entry_row(cell.octant, points[c]);
    corner.point = direction(to_vertex(cell.octant, points[c], geometry.entry_resolution()));
    corner.weight = static_cast<float>(cell.weights[c]);
    corner.aim = pixel.ray.leave;
  }
}

Tap make_tap(const LevelGeometry& geometry, const EntryCorner& corner, bool nearest) {
  Cell cell = locate(corner.aim, geometry.exit_resolution());
  if (nearest) keep_greatest(cell.weights);
  const auto exit = geometry.exit_cell(cell);
  Tap tap{corner.row.section, exit.section, corner.row.row, exit.columns, {}};
  for (std::size_t c = 0; c < 3; ++c) tap.weights[c] = static_cast<float>(cell.weights[c]);
  return tap;
}

/// Where the ray from a point of the unit sphere through another point leaves the sphere.
glm::dvec3 leave_sphere(const glm::dvec3& from, const glm::dvec3& through) {
  const glm::dvec3 d = through - from;
  const double length2 = glm::dot(d, d);
  if (!(length2 > 0)) return from;
  return from - 2 * glm::dot(from, d) / length2 * d;
}

}  // namespace

bool cross_sphere(const Sphere& sphere, const PixelRay& pixel, Ray& ray) {
  const Chord chord = intersect(sphere, pixel.origin, pixel.direction);
  if (!chord.hit || chord.leave <= 0) return false;
  const auto at = [&](double t) {
    return glm::normalize(pixel.origin + t * pixel.direction - sphere.center);
  };
  ray.enter = at(chord.enter);
  ray.leave = at(chord.leave);
  return true;
}

Result<void> BlockRenderer::draw(std::vector<Pixel>& pixels, std::uint64_t& fallback) {
  active_.resize(pixels.size());
  for (std::uint32_t k = 0; k < pixels.size(); ++k) active_[k] = k;
  for (unsigned level = options_.level + 1; level-- > 0 && !active_.empty();) {
    if (auto ok = draw_level(pixels, field_.geometry(level)); !ok) return ok;
    std::erase_if(active_, [&](std::uint32_t k) { return !pixels[k].missing; });
    fallback += active_.size();
  }
  return {};
}

Result<void> BlockRenderer::draw_level(std::vector<Pixel>& pixels, const LevelGeometry& geometry) {
  const RenderMode mode = options_.mode;
  const bool one_entry = mode == RenderMode::nearest || mode == RenderMode::st;
  for (const std::uint32_t k : active_) {
    find_corners(geometry, one_entry, pixels[k]);
    pixels[k].missing = false;
  }
  if (auto ok = pass(pixels, geometry, active_, options_.needs_depth()); !ok) return ok;
  if (mode != RenderMode::depth) return {};
  for (int k = 1; k <= kDepthPasses; ++k) {
    followed_.clear();
    for (const std::uint32_t p : active_) {
      Pixel& pixel = pixels[p];
      if (pixel.missing || pixel.rgba.a <= kFaint) continue;
      const glm::dvec3 seen = pixel.ray.at(pixel.t);
      for (EntryCorner& corner : pixel.corners) corner.aim = leave_sphere(corner.point, seen);
      followed_.push_back(p);
    }
    const bool more = k < kDepthPasses || options_.with_depth;
    if (auto ok = pass(pixels, geometry, followed_, more); !ok) return ok;
  }
  return {};
}

Result<void> BlockRenderer::pass(std::vector<Pixel>& pixels, const LevelGeometry& geometry,
                                 const Indices& which, bool with_depth) {
  const bool one_exit = options_.mode == RenderMode::nearest || options_.mode == RenderMode::uv;
  taps_.clear();
  for (const std::uint32_t k : which)
    for (EntryCorner& corner : pixels[k].corners) {
      if (corner.weight == 0) continue;
      corner.tap = static_cast<std::uint32_t>(taps_.size());
      taps_.push_back(make_tap(geometry, corner, one_exit));
    }
  if (auto ok = gatherer_.gather(geometry, taps_, with_depth, values_); !ok) return ok;
  for (const std::uint32_t k : which) blend(pixels[k], with_depth);
  return {};
}

void BlockRenderer::blend(Pixel& pixel, bool with_depth) const {
  const glm::dvec3 along = pixel.ray.leave - pixel.ray.enter;
  const double length2 = glm::dot(along, along);
  glm::vec4 rgba(0);
  double t = 0;
  for (const EntryCorner& corner : pixel.corners) {
    if (corner.weight == 0) continue;
    const TapValue& value = values_[corner.tap];
    pixel.missing |= value.missing;
    rgba += corner.weight * value.rgba;
    if (!with_depth || value.rgba.a <= 0) continue;
    // Where the corner's ray saw something, as a position along the pixel's.
    const glm::dvec3 seen =
        corner.point + double{value.depth / value.rgba.a} * (corner.aim - corner.point);
    t += corner.weight * value.rgba.a * glm::dot(seen - pixel.ray.enter, along) / length2;
  }
  pixel.rgba = rgba;
  if (with_depth && rgba.a > 0) pixel.t = static_cast<float>(std::clamp(t / rgba.a, 0.0, 1.0));
}

}  // namespace slf
