#include "slf/scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace slf {
namespace {

glm::dvec3 on_unit_sphere(std::mt19937& random) {
  std::normal_distribution<double> normal;
  return glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
}

TEST(Analytic, EveryNamedSceneIsVisibleWithinItsBounds) {
  for (const std::string& name : analytic_scene_names()) {
    const auto scene = make_analytic_scene(name);
    ASSERT_TRUE(scene) << name;
    std::mt19937 random(1);
    int visible = 0;
    for (int k = 0; k < 1000; ++k) {
      const RaySample s = (*scene)->trace(on_unit_sphere(random), on_unit_sphere(random));
      EXPECT_GE(s.depth, 0);
      EXPECT_LE(s.depth, 1);
      for (int c = 0; c < 3; ++c) EXPECT_LE(s.rgba[c], s.rgba.a + 1e-6);
      visible += s.rgba.a > 0;
    }
    EXPECT_GT(visible, 300) << name;
  }
  EXPECT_EQ(make_analytic_scene("nowhere").error().code, ErrorCode::usage);
}

TEST(Analytic, OpaqueBallsAreHitWhereGeometrySays) {
  const auto scene = std::move(*make_analytic_scene("globe"));  // radius 0.9 around the origin
  std::mt19937 random(2);
  for (int k = 0; k < 1000; ++k) {
    const glm::dvec3 from = on_unit_sphere(random), to = on_unit_sphere(random);
    const RaySample s = scene->trace(from, to);
    const glm::dvec3 d = to - from;
    const double nearest = -glm::dot(from, d) / glm::dot(d, d);
    const bool hits = glm::length(from + nearest * d) < 0.9;
    ASSERT_EQ(s.rgba.a, hits ? 1.f : 0.f);
    if (hits) {
      EXPECT_NEAR(glm::length(from + double{s.depth} * d), 0.9, 1e-6);
    }
  }
}

TEST(Analytic, FogIsTheIntegralOfItsDensity) {
  // Against a plain Riemann sum over the same balls: first ball alone where the ray misses others.
  const auto scene = std::move(*make_analytic_scene("fog"));
  const glm::dvec3 from(0.0, -1, 0.72), to(0.0, 1, 0.72);  // only the big ball, radius 0.8
  const double path = 2 * std::sqrt(0.8 * 0.8 - 0.72 * 0.72);
  const RaySample s = scene->trace(from, to);
  EXPECT_NEAR(s.rgba.a, 1 - std::exp(-0.5 * path), 1e-6);
  double alpha = 0, depth = 0;
  const int n = 200000;
  for (int k = 0; k < n; ++k) {
    const double t = (k + 0.5) / n;
    if (glm::length(from + t * (to - from)) > 0.8) continue;
    const double a = (1 - alpha) * 0.5 * 2 / n;
    alpha += a;
    depth += a * t;
  }
  EXPECT_NEAR(s.rgba.a, alpha, 1e-4);
  EXPECT_NEAR(s.depth, depth / alpha, 1e-4);
}

}  // namespace
}  // namespace slf
