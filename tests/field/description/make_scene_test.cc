#include "slf/scene_description.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace slf {
namespace {

using ::testing::HasSubstr;

/// A ball in a grid of 12 voxels along each edge.
std::shared_ptr<const Volume> ball() {
  auto volume = std::make_shared<Volume>();
  volume->dims = {12, 12, 12};
  volume->source = "ball";
  for (int z = 0; z < 12; ++z)
    for (int y = 0; y < 12; ++y)
      for (int x = 0; x < 12; ++x) {
        const double r = glm::length(glm::dvec3(x, y, z) - 5.5);
        volume->voxels.push_back(static_cast<std::byte>(std::max(0.0, 250 - 45 * r)));
      }
  return volume;
}

SceneDescription description() {
  SceneDescription d;
  d.volume = ball();
  return d;
}

nlohmann::json provenance(const SceneDescription& d) {
  const auto scene = make_scene(d);
  EXPECT_TRUE(scene) << scene.error().message;
  return scene ? nlohmann::json::parse((*scene)->provenance()) : nlohmann::json();
}

TEST(MakeScene, LightIsGlobalUnlessRaysNeedNone) {
  EXPECT_EQ(provenance(description())["lighting"]["mode"], "global");
  SceneDescription d = description();
  d.ambient = 0.5f;
  EXPECT_EQ(provenance(d)["ambient"], 0.5f);
  EXPECT_FALSE(provenance(d).contains("lighting"));
  d = description();
  d.raycast.projection = Projection::maximum;
  EXPECT_EQ(provenance(d)["projection"], "mip");
  EXPECT_EQ(provenance(d)["shade"], false);
}

TEST(MakeScene, WhatAProvenanceRecordsIsReadBack) {
  SceneDescription built = description();
  built.transfer = "ct-bone";
  built.range = {20, 200};
  built.light_rig = built_in_rigs().back().name;
  built.light = glm::dvec3(0, -1, 0);
  built.raycast.step = 1;
  built.raycast.lighting.samples = 3;
  built.raycast.lighting.linear = true;
  built.labels_volume.volume = ball();
  nlohmann::json expected = provenance(built);

  SceneDescription truth = description();
  truth.labels_volume.volume = ball();
  truth.truth_of = expected.dump();
  expected["step"] = 0.5;
  EXPECT_EQ(provenance(truth), expected);
  truth.labels_volume = {};
  const auto without = make_scene(truth);
  ASSERT_FALSE(without);
  EXPECT_EQ(without.error().code, ErrorCode::usage);
  EXPECT_STREQ(without.error().choice, "labels_volume");
}

TEST(MakeScene, RefusesWhatOnlyVolumesHave) {
  SceneDescription d;
  d.input = "scene:balls";
  EXPECT_TRUE(make_scene(d));
  d.mask.path = "mask.nii";
  const auto scene = make_scene(d);
  ASSERT_FALSE(scene);
  EXPECT_THAT(scene.error().message, HasSubstr("mask: only for volumes"));
}

TEST(MakeScene, ChecksFilesBeforeItReadsThem) {
  SceneDescription d;
  d.input = "missing.nii";
  d.transfer = "missing.json";
  std::vector<std::string> checked;
  d.check = [&](const std::vector<std::string>& files) -> Result<void> {
    checked = files;
    return fail(ErrorCode::usage, "stop");
  };
  EXPECT_EQ(make_scene(d).error().message, "stop");
  EXPECT_THAT(checked, ::testing::IsSupersetOf({"missing.nii", "missing.json"}));
}

}  // namespace
}  // namespace slf
