// What doc/drawing.md says a view shows, one sample at a time, beside what the renderer draws.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "field/field_file.h"
#include "field/tiles/tile_cache.h"
#include "slf/render.h"
#include "slf/scene.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

/// The three samples around an exit point, of an entry vertex's rays.
struct Tap {
  glm::dvec3 from, to;  // on the unit sphere
  double weight = 0;    // of the entry vertex
  std::array<double, 3> weights{};
  std::array<glm::dvec4, 3> rgba{};
  std::array<double, 3> depth{};
  /// [i][j]: the sample at the next exit vertex on the line from j through i, in the same tile.
  std::array<std::array<std::optional<glm::dvec4>, 3>, 3> next{};
};

/// A column of tiles of a side, as local coordinates.
glm::ivec2 local_point(std::uint32_t column, int side) {
  auto p = static_cast<int>(column);
  int q = 0;
  while (p > side - q) p -= side - q++ + 1;
  return {p, q};
}

/// A ray's colour by the definitions in doc/drawing.md, one sample at a time, in double.
class Definition {
 public:
  Definition(const Field& field, unsigned level, TileCache& cache, const PixelRay& ray)
      : geometry_(field.file().geometry(level)), cache_(cache) {
    const Sphere& sphere = field.shape().sphere;
    const Chord chord = intersect(sphere, ray.origin, ray.direction);
    hit_ = chord.hit;
    if (!hit_) return;
    const auto at = [&](double t) {
      return (ray.origin + t * ray.direction - sphere.center) / sphere.radius;
    };
    enter_ = at(chord.enter), leave_ = at(chord.leave);
    cell_ = locate(enter_, geometry_.entry_resolution());
    for (std::size_t c = 0; c < 3; ++c) take(c, leave_);
  }

  [[nodiscard]] glm::dvec4 bi_triangle() const {
    glm::dvec4 rgba(0);
    for (const Tap& tap : taps_)
      for (std::size_t e = 0; e < 3; ++e) rgba += tap.weight * tap.weights[e] * tap.rgba[e];
    return rgba;
  }

  [[nodiscard]] glm::dvec4 depth_corrected() {
    glm::dvec4 rgba = bi_triangle();
    if (!hit_ || !see()) return rgba;
    std::array<double, 3> aims{t_, t_, t_}, next{};
    for (int round = 0; round < 3; ++round) {
      for (std::size_t c = 0; c < 3; ++c) {
        const glm::dvec3 along = enter_ + aims[c] * (leave_ - enter_) - taps_[c].from;
        take(c,
             taps_[c].from - 2 * glm::dot(taps_[c].from, along) / glm::dot(along, along) * along);
      }
      const glm::dvec4 before = rgba;
      rgba = agreed(aims);
      see();
      double step = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        next[c] = (t_ + own_[c]) / 2;
        if (taps_[c].weight > 0) step = std::max(step, std::abs(next[c] - aims[c]));
      }
      if (step <= geometry_.entry_resolution() / 4096.0) break;
      if (round < 2)
        aims = next;
      else
        rgba += 0.4 * (before - rgba);
    }
    const auto [low, high] = range();
    const glm::dvec4 contrast = high - low;
    if (std::max({contrast.r, contrast.g, contrast.b}) < 0.1) return rgba;
    return glm::clamp(rgba + bend(aims), glm::min(low, rgba), glm::max(high, rgba));
  }

 private:
  void take(std::size_t c, const glm::dvec3& exit_point) {
    Tap& tap = taps_[c];
    const OctantPoint corner = cell_.corners()[c];
    const Cell cell = locate(exit_point, geometry_.exit_resolution());
    const auto exit = geometry_.exit_cell(cell);
    const EntryRow row = geometry_.entry_row(cell_.octant, corner);
    const TileKey key =
        tile_key({geometry_.entry_section(row.section), geometry_.exit_section(exit.section)});
    tap = {direction(to_vertex(cell_.octant, corner, geometry_.entry_resolution())),
           exit_point,
           cell_.weights[c],
           cell.weights,
           {},
           {},
           {}};
    if (tap.weight <= 0) return;
    const auto pin = cache_.load(key);
    if (!pin || pin->samples().empty()) return;
    const std::byte* const colors = pin->samples().data();
    const std::byte* const depths =
        colors + geometry_.tile(row.section, SampleFormat::rgba8).color_bytes();
    for (std::size_t e = 0; e < 3; ++e) {
      const std::size_t sample =
          std::size_t{row.row} * triangle_size(geometry_.exit_side()) + exit.columns[e];
      for (int channel = 0; channel < 4; ++channel)
        tap.rgba[e][channel] = std::to_integer<int>(colors[4 * sample + channel]) / 255.0;
      tap.depth[e] = std::to_integer<int>(depths[sample]) / 255.0;
    }
    take_next(tap, row.row, exit.columns, colors);
  }

  void take_next(Tap& tap, std::uint32_t row, const std::array<std::uint32_t, 3>& columns,
                 const std::byte* colors) {
    const auto side = static_cast<int>(geometry_.exit_side());
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j) {
        const glm::ivec2 p = 2 * local_point(columns[i], side) - local_point(columns[j], side);
        if (i == j || p.x < 0 || p.y < 0 || p.x + p.y > side) continue;
        const int column = p.y * (side + 1) - p.y * (p.y - 1) / 2 + p.x;
        const std::byte* const at =
            colors + 4 * (row * triangle_size(geometry_.exit_side()) + column);
        glm::dvec4 rgba;
        for (int channel = 0; channel < 4; ++channel)
          rgba[channel] = std::to_integer<int>(at[channel]) / 255.0;
        tap.next[i][j] = rgba;
      }
  }

  /// Where a depth of a tap lies along the ray.
  [[nodiscard]] double place(const Tap& tap, double depth) const {
    const glm::dvec3 ray = leave_ - enter_;
    return glm::dot(tap.from + depth * (tap.to - tap.from) - enter_, ray) / glm::dot(ray, ray);
  }

  /// Estimates t_ and own_; false where too little is seen.
  bool see() {
    constexpr double kFaint = 1.0 / 255;
    double all = 0, sum = 0;
    std::array<double, 3> opacity{}, places{};
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t e = 0; e < 3; ++e) {
        const double visible = taps_[c].weights[e] * taps_[c].rgba[e].a;
        opacity[c] += visible;
        places[c] += visible * place(taps_[c], taps_[c].depth[e]);
      }
      all += taps_[c].weight * opacity[c];
      sum += taps_[c].weight * places[c];
    }
    if (all > kFaint) t_ = std::clamp(sum / all, 0.0, 1.0);
    for (std::size_t c = 0; c < 3; ++c)
      own_[c] = opacity[c] > kFaint ? std::clamp(places[c] / opacity[c], 0.0, 1.0) : t_;
    return all > kFaint;
  }

  /// The share of its weight that a sample keeps.
  [[nodiscard]] double agreement(const Tap& tap, std::size_t e, double aim) const {
    const double off = (place(tap, tap.depth[e]) - aim) / (6.4 / geometry_.exit_resolution());
    return 1 - 0.9 * std::min(4 * tap.rgba[e].a, 1.0) * std::min(off * off, 1.0);
  }

  /// The least and the greatest values of the samples.
  [[nodiscard]] std::pair<glm::dvec4, glm::dvec4> range() const {
    glm::dvec4 low(1), high(0);
    for (const Tap& tap : taps_)
      for (const glm::dvec4& rgba : tap.rgba)
        low = glm::min(low, rgba), high = glm::max(high, rgba);
    return {low, high};
  }

  /// What a cubic between the exit vertices adds to the pixel.
  [[nodiscard]] glm::dvec4 bend(const std::array<double, 3>& aims) const {
    glm::dvec4 sum(0);
    double total = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      const Tap& tap = taps_[c];
      const auto& v = tap.rgba;
      const auto& w = tap.weights;
      glm::dvec4 linear(0), cubic(0);
      double agreed = 0;
      for (std::size_t i = 0; i < 3; ++i) {
        linear += w[i] * v[i];
        agreed += w[i] * agreement(tap, i, aims[c]);
        const std::size_t j = (i + 1) % 3;
        const auto &beyond_i = tap.next[i][j], &beyond_j = tap.next[j][i];
        if (w[i] * w[j] <= 0 || (!beyond_i && !beyond_j)) continue;
        glm::dvec4 at_i(0), at_j(0);
        if (beyond_i) at_i = *beyond_i - 2.0 * v[i] + v[j];
        if (beyond_j) at_j = v[i] - 2.0 * v[j] + *beyond_j;
        if (!beyond_i) at_i = at_j;
        if (!beyond_j) at_j = at_i;
        const double share = w[i] / (w[i] + w[j]);
        cubic -= 0.625 * w[i] * w[j] * ((1 + share) * at_i + (2 - share) * at_j) / 3.0;
      }
      cubic = glm::clamp(linear + cubic, glm::min(v[0], glm::min(v[1], v[2])),
                         glm::max(v[0], glm::max(v[1], v[2])));
      sum += tap.weight * agreed * (cubic - linear);
      total += tap.weight * agreed;
    }
    return sum / total;
  }

  [[nodiscard]] glm::dvec4 agreed(const std::array<double, 3>& aims) const {
    glm::dvec4 rgba(0);
    double total = 0;
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t e = 0; e < 3; ++e) {
        const Tap& tap = taps_[c];
        const double weight = tap.weight * tap.weights[e] * agreement(tap, e, aims[c]);
        rgba += weight * tap.rgba[e];
        total += weight;
      }
    return rgba / total;
  }

  const LevelGeometry& geometry_;
  TileCache& cache_;
  bool hit_ = false;
  glm::dvec3 enter_{0.0}, leave_{0.0};
  Cell cell_;
  std::array<Tap, 3> taps_;
  double t_ = 0;
  std::array<double, 3> own_{};
};

/// How many pixels are not what the definition says.
std::size_t different_pixels(const Field& field, TileCache& cache, const Camera& camera,
                             const Image& image, RenderMode mode) {
  const auto rays = *RayGenerator::make(camera);
  std::size_t different = 0;
  for (std::uint32_t y = 0; y < camera.height; ++y)
    for (std::uint32_t x = 0; x < camera.width; ++x) {
      Definition ray(field, 2, cache, rays.ray(x, y));
      const glm::vec4 expected(mode == RenderMode::bitri ? ray.bi_triangle()
                                                         : ray.depth_corrected());
      const glm::vec4 off = glm::abs(image.rgba[y * camera.width + x] - expected);
      different += !glm::all(glm::lessThan(off, glm::vec4(1.f / 255)));
    }
  return different;
}

/// Faint material at two depths, beside the opaque one of the analytic scenes: samples are judged
/// by both.
RaySample veil(const glm::dvec3& from, const glm::dvec3& to) {
  const float alpha = from.y + to.y > 0.1 ? 0.12f : 0.2f;
  const bool near = std::sin(9 * to.x) + std::sin(8 * to.z) > 0;
  const glm::vec3 color = near ? glm::vec3(1, 0.5, 0) : glm::vec3(0, 0.2, 1);
  return {glm::vec4(alpha * color, alpha), near ? 0.35f : 0.6f};
}

std::unique_ptr<Scene> make_scene(const std::string& name) {
  if (name == "veil") return std::make_unique<testing::FunctionScene>(veil);
  return std::move(*make_analytic_scene(name));
}

class RenderDefinition : public ::testing::TestWithParam<const char*> {};

TEST_P(RenderDefinition, PicturesAreThoseOfFormatMd) {
  const testing::TemporaryFolder folder;
  const auto scene = make_scene(GetParam());
  const auto field =
      testing::build_and_open(*scene, folder / "a.slf", testing::lossless_options(4, 16, 2));
  ASSERT_TRUE(field);
  TileCache cache(field->file(), 1ull << 30);
  Renderer renderer(*field);
  for (const double distance : {1.3, 3.0, 40.0}) {
    const Camera camera = orbit_camera(field->shape().sphere, 20, 50, distance, 101, 90);
    for (const RenderMode mode : {RenderMode::bitri, RenderMode::depth}) {
      const auto image = renderer.render(camera, {mode, 2, false});
      ASSERT_TRUE(image);
      // A ray may stop a round earlier or later by rounding.
      EXPECT_LE(different_pixels(*field, cache, camera, *image, mode),
                mode == RenderMode::bitri ? 0u : image->pixels() / 1000)
          << name(mode) << " " << distance;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, RenderDefinition, ::testing::Values("balls", "fog", "veil"));

}  // namespace
}  // namespace slf
