#include "slf/scene.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <span>

#include "base/join.h"
#include "base/owned_json.h"
#include "base/try.h"

namespace slf {
namespace {

struct Ball {
  Sphere sphere;
  glm::dvec3 color;
  double texture;  ///< periods of the pattern around the ball
  double density;  ///< per world unit; infinite for opaque balls
};

constexpr double kSolid = INFINITY;
constexpr std::size_t kMaxBalls = 6;
const glm::dvec3 kLight = glm::normalize(glm::dvec3(-0.45, -0.65, 0.6));

/// A smooth pattern in 0.35..1 over the surface.
double pattern(const Ball& ball, const glm::dvec3& normal) {
  const glm::dvec3 p = normal * ball.texture;
  return 0.675 + 0.325 * std::sin(p.x + 1.3 * p.z) * std::cos(p.y - 0.7 * p.x);
}

glm::dvec3 surface_color(const Ball& ball, const glm::dvec3& point) {
  const glm::dvec3 normal = (point - ball.sphere.center) / ball.sphere.radius;
  const double light = 0.3 + 0.7 * std::max(0.0, glm::dot(normal, kLight));
  return ball.color * pattern(ball, normal) * light;
}

class Balls final : public Scene {
 public:
  Balls(std::string name, std::vector<Ball> balls)
      : name_(std::move(name)), balls_(std::move(balls)) {
    assert(balls_.size() <= kMaxBalls);
  }

  Sphere bounds() const override { return {glm::dvec3(0), 1}; }

  RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override {
    const glm::dvec3 direction = to - from;
    const double length = glm::length(direction);
    if (!(length > 0)) return {};

    // The positions where density changes along the ray, up to the first opaque ball.
    double end = 1;
    const Ball* solid = nullptr;
    std::array<double, 2 * kMaxBalls + 2> memory;
    std::size_t count = 0;
    memory[count++] = 0;
    for (const Ball& ball : balls_) {
      const Chord chord = intersect(ball.sphere, from, direction);
      if (!chord.hit || chord.leave <= 0 || chord.enter >= 1) continue;
      if (ball.density == kSolid) {
        if (chord.enter > 0 && chord.enter < end) end = chord.enter, solid = &ball;
      } else {
        memory[count++] = std::clamp(chord.enter, 0.0, 1.0);
        memory[count++] = std::clamp(chord.leave, 0.0, 1.0);
      }
    }
    memory[count++] = end;
    const std::span cuts(memory.data(), count);
    std::sort(cuts.begin(), cuts.end());

    // Between two cuts the density is constant, so the integrals are exact.
    glm::dvec3 color(0);
    double through = 1, depth = 0;
    for (std::size_t k = 0; k + 1 < cuts.size() && cuts[k + 1] <= end; ++k)
      absorb(from, direction, length, cuts[k], cuts[k + 1], color, through, depth);
    if (solid) {
      color += through * surface_color(*solid, from + end * direction);
      depth += through * end;
      through = 0;
    }
    const double alpha = 1 - through;
    if (alpha <= 0) return {};
    return {glm::vec4(glm::vec3(color), static_cast<float>(alpha)),
            static_cast<float>(depth / alpha)};
  }

  std::string provenance() const override {
    OwnedJson json = nlohmann::json::object();
    (*json)["kind"] = "scene";
    (*json)["name"] = name_;
    return json->dump();
  }

 private:
  /// Adds emission and absorption of the fog between two points.
  void absorb(const glm::dvec3& from, const glm::dvec3& direction, double length, double t0,
              double t1, glm::dvec3& color, double& through, double& depth) const {
    if (!(t1 > t0)) return;
    const glm::dvec3 middle = from + 0.5 * (t0 + t1) * direction;
    double density = 0;
    glm::dvec3 emitted(0);
    for (const Ball& ball : balls_) {
      if (ball.density == kSolid || glm::distance(middle, ball.sphere.center) > ball.sphere.radius)
        continue;
      density += ball.density;
      emitted += ball.density * ball.color;
    }
    if (density <= 0) return;
    const double rate = density * length;  // per unit of t
    const double left = std::exp(-rate * (t1 - t0));
    color += through * (1 - left) * emitted / density;
    // Integral of rate · t · exp(-rate (t - t0)) over [t0, t1].
    depth += through * ((t0 + 1 / rate) - (t1 + 1 / rate) * left);
    through *= left;
  }

  std::string name_;
  std::vector<Ball> balls_;
};

std::vector<Ball> make_balls() {
  return {{{{0, 0, 0}, 0.45}, {0.9, 0.85, 0.75}, 14, kSolid},
          {{{0.55, 0.2, 0.1}, 0.22}, {0.9, 0.35, 0.25}, 9, kSolid},
          {{{-0.5, 0.3, -0.2}, 0.25}, {0.3, 0.6, 0.9}, 11, kSolid},
          {{{0.1, -0.6, 0.3}, 0.2}, {0.4, 0.8, 0.4}, 8, kSolid},
          {{{-0.2, -0.1, 0.7}, 0.15}, {0.95, 0.8, 0.3}, 6, kSolid},
          {{{0.15, 0.35, -0.7}, 0.18}, {0.7, 0.45, 0.85}, 7, kSolid}};
}

std::vector<Ball> make_globe() { return {{{{0, 0, 0}, 0.9}, {1, 0.95, 0.9}, 40, kSolid}}; }

std::vector<Ball> make_fog() {
  return {{{{0, 0, 0}, 0.8}, {0.35, 0.45, 0.6}, 0, 0.5},
          {{{0.3, 0.1, 0}, 0.4}, {0.9, 0.4, 0.2}, 0, 2.0},
          {{{-0.3, -0.2, 0.2}, 0.35}, {0.3, 0.8, 0.4}, 0, 3.0},
          {{{0, 0.2, -0.4}, 0.3}, {0.9, 0.85, 0.4}, 0, 1.5}};
}

}  // namespace

std::vector<std::string> analytic_scene_names() { return {"balls", "globe", "fog"}; }

Result<std::unique_ptr<Scene>> make_analytic_scene(std::string_view name) try {
  std::vector<Ball> balls;
  if (name == "balls") {
    balls = make_balls();
  } else if (name == "globe") {
    balls = make_globe();
  } else if (name == "fog") {
    balls = make_fog();
  } else {
    return fail(ErrorCode::usage, "unknown scene '", name,
                "'; known: ", joined(analytic_scene_names()));
  }
  return std::unique_ptr<Scene>(new Balls(std::string(name), std::move(balls)));
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
