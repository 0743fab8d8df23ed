#include <gtest/gtest.h>

#include <cmath>

#include "slf/camera.h"
#include "slf/render.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using testing::FunctionScene;

constexpr double kBall = 0.6;

/// An opaque ball around the centre of the sphere.
RaySample ball(const glm::dvec3& from, const glm::dvec3& to) {
  const glm::dvec3 d = to - from;
  const double a = dot(d, d), b = dot(from, d), c = dot(from, from) - kBall * kBall;
  const double rest = b * b - a * c;
  if (rest <= 0) return {};
  RaySample sample;
  sample.rgba = {0.5f, 0.4f, 0.3f, 1};
  sample.depth = static_cast<float>((-b - std::sqrt(rest)) / a);
  return sample;
}

class Pick : public ::testing::Test {
 protected:
  Pick() {
    auto options = testing::lossless_options(4, 16, 2);
    options.depth = true;
    field_ = testing::build_and_open(FunctionScene(ball), folder_ / "ball.slf", options);
  }
  /// Where the line of sight meets the ball.
  static glm::dvec3 truth(const Camera& camera, double x, double y) {
    const RayGenerator rays = *RayGenerator::make(camera);
    const glm::dvec3 d = normalize(rays.corner() + x * rays.across() + y * rays.down());
    const double b = dot(rays.eye(), d), c = dot(rays.eye(), rays.eye()) - kBall * kBall;
    return rays.eye() + (-b - std::sqrt(b * b - c)) * d;
  }

  testing::TemporaryFolder folder_;
  std::optional<Field> field_;
};

TEST_F(Pick, FindsPointsOfASurfaceAndTheirErrors) {
  Renderer renderer(*field_);
  for (const double azimuth : {0.0, 77.0, 200.0}) {
    const Camera camera = orbit_camera({{}, 1}, azimuth, 20, 3, 256, 256);
    glm::dvec3 first{0}, expected_first{0};
    for (const auto& [x, y] : {std::pair{90.5, 100.5}, {128.0, 128.0}, {150.25, 90.0}}) {
      const auto found = pick(renderer, camera, x, y);
      ASSERT_TRUE(found) << found.error().message;
      ASSERT_TRUE(*found);
      const glm::dvec3 expected = truth(camera, x, y);
      EXPECT_LT(distance((*found)->point, expected), 0.02);
      EXPECT_LT(distance((*found)->point, expected), 3 * (*found)->uncertainty);
      EXPECT_LT((*found)->uncertainty, 0.05);
      EXPECT_NEAR((*found)->depth, distance((*found)->point, camera.eye), 1e-6);
      if (first != glm::dvec3(0)) {  // a ruler
        EXPECT_NEAR(distance(first, (*found)->point), distance(expected_first, expected), 0.02);
      }
      first = (*found)->point;
      expected_first = expected;
    }
  }
}

TEST_F(Pick, FindsNothingBesideTheObject) {
  Renderer renderer(*field_);
  const Camera camera = orbit_camera({{}, 1}, 30, 20, 3, 64, 64);
  for (const auto& [x, y] : {std::pair{0.0, 0.0}, {10.5, 32.0}, {63.9, 63.9}}) {
    const auto found = pick(renderer, camera, x, y);
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_FALSE(*found);
  }
}

TEST_F(Pick, RefusesPlacesOutsideThePicture) {
  Renderer renderer(*field_);
  const Camera camera = orbit_camera({{}, 1}, 30, 20, 3, 64, 48);
  for (const auto& [x, y] : {std::pair{-0.1, 0.0}, {64.0, 1.0}, {1.0, 48.0}, {NAN, 1.0}}) {
    const auto found = pick(renderer, camera, x, y);
    ASSERT_FALSE(found);
    EXPECT_EQ(found.error().code, ErrorCode::usage);
  }
}

}  // namespace
}  // namespace slf
