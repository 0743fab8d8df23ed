// What FORMAT.md says a view shows, one sample at a time, beside what the renderer draws.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>

#include "field/field_file.h"
#include "field/render/tile_cache.h"
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
};

/// A ray's colour by the definitions in FORMAT.md, one sample at a time, in double.
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
    std::array<double, 3> aims{t_, t_, t_};
    for (int round = 0; round < 3; ++round) {
      for (std::size_t c = 0; c < 3; ++c) {
        const glm::dvec3 along = enter_ + aims[c] * (leave_ - enter_) - taps_[c].from;
        take(c,
             taps_[c].from - 2 * glm::dot(taps_[c].from, along) / glm::dot(along, along) * along);
      }
      rgba = agreed(aims);
      see();
      double step = 0;
      for (std::size_t c = 0; c < 3; ++c) {
        const double next = (t_ + own_[c]) / 2;
        if (taps_[c].weight > 0) step = std::max(step, std::abs(next - aims[c]));
        aims[c] = next;
      }
      if (step <= geometry_.entry_resolution() / 2048.0) break;
    }
    return rgba;
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
           {}};
    const auto pin = cache_.load({key}, true);
    if (!pin || !pin->page().color) return;
    const TilePage& page = pin->page();
    for (std::size_t e = 0; e < 3; ++e) {
      const std::size_t sample =
          std::size_t{row.row} * triangle_size(geometry_.exit_side()) + exit.columns[e];
      for (int channel = 0; channel < 4; ++channel)
        tap.rgba[e][channel] = std::to_integer<int>(page.color[4 * sample + channel]) / 255.0;
      tap.depth[e] = std::to_integer<int>(page.depth[sample]) / 255.0;
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

  [[nodiscard]] glm::dvec4 agreed(const std::array<double, 3>& aims) const {
    glm::dvec4 rgba(0);
    double total = 0;
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t e = 0; e < 3; ++e) {
        const Tap& tap = taps_[c];
        const double off =
            (place(tap, tap.depth[e]) - aims[c]) / (6.4 / geometry_.exit_resolution());
        const double weight =
            tap.weight * tap.weights[e] *
            (1 - 0.9 * std::min(4 * tap.rgba[e].a, 1.0) * std::min(off * off, 1.0));
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
