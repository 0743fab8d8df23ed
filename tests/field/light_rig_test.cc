// Rigs of lights as text, and the tone mapper.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "field/scene/light_rig.h"
#include "slf/tone.h"

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
