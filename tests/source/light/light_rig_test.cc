// Rigs of lights as text, and the tone mapper.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "slf/tone.h"
#include "source/light/illumination.h"
#include "source/light/light_rig.h"
#include "source/medium/medium.h"

namespace slf {
namespace {

TEST(LightRig, EveryBuiltInOneReadsBack) {
  for (const LightRig& rig : built_in_rigs()) {
    const auto named = read_rig(rig.name);
    ASSERT_TRUE(named) << named.error().message;
    EXPECT_EQ(to_json(*named), to_json(rig));
    const auto parsed = parse_rig(to_json(rig), "a.json");
    ASSERT_TRUE(parsed) << parsed.error().message;
    EXPECT_EQ(to_json(*parsed), to_json(rig));
    EXPECT_FALSE(rig.description.empty());
  }
}

TEST(LightRig, NoSideIsOverexposed) {
  // The radiance of a white surface without shadows, whatever it faces.
  constexpr int kDirections = 4096;
  const auto direction = [](int k) {  // a Fibonacci sphere
    return uniform_direction((k + 0.5) / kDirections, k * 0.6180339887498949);
  };
  for (const LightRig& rig : built_in_rigs()) {
    LightOptions options;
    options.rig = rig;
    const Illumination light = illuminate(options, {glm::dvec3(0), 1});
    double brightest = 0;
    for (int n = 0; n < kDirections; n += 16) {
      glm::dvec3 sum(0);
      for (int k = 0; k < kDirections; ++k)
        sum += 4.0 / kDirections * std::max(0.0, glm::dot(direction(n), direction(k))) *
               glm::dvec3(light.environment.radiance(direction(k)));
      for (const PlacedLight& one : light.lights) {
        const IncidentLight arrival = one.incident_light(glm::dvec3(0), 0, 0);
        sum += std::max(0.0, glm::dot(direction(n), arrival.direction)) / std::numbers::pi *
               glm::dvec3(arrival.irradiance);
      }
      brightest = std::max({brightest, sum.r, sum.g, sum.b});
    }
    EXPECT_GT(brightest, 1) << rig.name;
    EXPECT_LT(brightest, 1.5) << rig.name;
  }
}

TEST(LightRig, ANameOfAnyBytesIsNoReasonToFail) {
  const auto rig = parse_rig("{}", "\xff.json");
  ASSERT_TRUE(rig);
  EXPECT_TRUE(parse_rig(to_json(*rig), "a.json"));
}

TEST(LightRig, MistakesAreNamed) {
  const auto unknown = read_rig("moonlight");
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().code, ErrorCode::usage);
  EXPECT_NE(unknown.error().message.find("studio"), std::string::npos);
  for (const auto& [text, place] : std::vector<std::pair<std::string, std::string>>{
           {"", "JSON object"},
           {"[]", "JSON object"},
           {R"({"lights": 3})", "lights: expected an array"},
           {R"({"lights": [{}]})", "lights[0].direction"},
           {R"({"lights": [{"direction": [0, 0]}]})", "lights[0].direction"},
           {R"({"lights": [{"direction": [0, 0, 1], "size": "big"}]})", "lights[0].size"},
           {R"({"lights": [{"direction": [0, 0, 1], "intensity": 1e39}]})", "lights[0].intensity"},
           {R"({"sky": {"up": [0, 1e39, 0]}})", "sky.up"},
           {R"({"sky": {"up": 1}})", "sky.up"}}) {
    const auto rig = parse_rig(text, "a.json");
    ASSERT_FALSE(rig) << text;
    EXPECT_EQ(rig.error().code, ErrorCode::bad_file);
    EXPECT_NE(rig.error().message.find(place), std::string::npos) << rig.error().message;
  }
}

TEST(ToneMapper, KeepsDarkColoursAndCompressesBrightOnes) {
  const ToneMapper neutral({}), srgb({0, ToneCurve::srgb}), none({3, ToneCurve::none});
  EXPECT_EQ(none({0.2f, 3, 0, 1}), glm::vec4(0.2f, 3, 0, 1));
  EXPECT_NEAR(srgb({0.5f, 0, 0, 1}).r, srgb_from_linear(0.5f), 1e-3);
  EXPECT_NEAR(srgb({9, 9, 9, 1}).r, 1, 1e-6);
  float before = 0;
  for (float v = 0; v < 100; v += 0.05f) {  // monotonous, and never white
    const float mapped = neutral(glm::vec4(v, v, v, 1)).r;
    EXPECT_GE(mapped, before);
    EXPECT_LE(mapped, 1);
    before = mapped;
  }
  const glm::vec4 half = srgb({0.25f, 0.25f, 0.25f, 0.5f});  // premultiplied
  EXPECT_NEAR(half.r, 0.5f * srgb_from_linear(0.5f), 1e-3);
  EXPECT_EQ(half.a, 0.5f);
}

}  // namespace
}  // namespace slf
