// Environments and near lights: where light comes from, and how much.
#include "source/light/illumination.h"

#include <gtest/gtest.h>

#include <numbers>

#include "source/medium/medium.h"

namespace slf {
namespace {

constexpr double kPi = std::numbers::pi;

TEST(Illumination, EnvironmentSamplesFollowTheirDensity) {
  Image picture;
  picture.width = 8, picture.height = 4;
  for (int k = 0; k < 32; ++k) picture.rgba.emplace_back(k % 5, k == 13 ? 40 : k % 3, 1, 1);
  const Environment sky(picture, 1);
  EXPECT_TRUE(sky.peaked());
  Random random(1);
  // The mean of radiance/density estimates the integral of radiance, which uniform directions
  // give as well; where a sample comes from, the look-up finds it again.
  double sampled = 0, uniform = 0;
  constexpr int kSamples = 200000;
  for (int k = 0; k < kSamples; ++k) {
    const double choice = random(), u = random(), v = random();
    const auto s = sky.sample(choice, u, v);
    EXPECT_NEAR(sky.density(s.direction), s.density, 1e-9);
    sampled += s.radiance.g / s.density / kSamples;
    uniform += 4 * kPi * sky.radiance(uniform_direction(random(), random())).g / kSamples;
  }
  EXPECT_NEAR(sampled / uniform, 1, 0.02);
}

TEST(Illumination, EnvironmentFacesThePatient) {
  Image picture;  // red in the middle, green right of it, blue on top
  picture.width = 4, picture.height = 3;
  picture.rgba.assign(12, glm::vec4(0, 0, 0, 1));
  for (int x = 0; x < 4; ++x) picture.rgba[x].b = 1;
  picture.rgba[4 + 2].r = 1;
  picture.rgba[4 + 3].g = 1;
  const Environment sky(picture, 2);
  EXPECT_EQ(sky.radiance({0.1, -1, 0}), glm::vec3(2, 0, 0));
  EXPECT_EQ(sky.radiance({1, 0.1, 0}), glm::vec3(0, 2, 0));
  EXPECT_EQ(sky.radiance({0, 0, 1}), glm::vec3(0, 0, 2));
}

TEST(Illumination, NearLightsFallOffWithDistance) {
  const Sphere bounds{glm::dvec3(1, 2, 3), 10};
  Light lamp{{0, 0, 1}};
  lamp.distance = 2;
  const PlacedLight light(lamp, bounds);
  const IncidentLight at_center = light.incident_light({1, 2, 3}, 0, 0),
                      nearer = light.incident_light({1, 2, 13}, 0, 0);
  EXPECT_NEAR(at_center.irradiance.r, kPi, 1e-5);
  EXPECT_NEAR(at_center.distance, 20, 1e-9);
  EXPECT_NEAR(nearer.irradiance.r, 4 * kPi, 1e-4);
}

}  // namespace
}  // namespace slf
