#include "slf/recipe.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
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

Recipe description() {
  Recipe d;
  d.volume = ball();
  return d;
}

nlohmann::json provenance(const Recipe& d) {
  const auto scene = make_scene(d);
  EXPECT_TRUE(scene) << scene.error().message;
  return scene ? nlohmann::json::parse((*scene)->provenance()) : nlohmann::json();
}

TEST(MakeScene, LightIsGlobalUnlessRaysNeedNone) {
  EXPECT_EQ(provenance(description())["lighting"]["mode"], "global");
  Recipe d = description();
  d.ambient = 0.5f;
  EXPECT_EQ(provenance(d)["ambient"], 0.5f);
  EXPECT_FALSE(provenance(d).contains("lighting"));
  d = description();
  d.raycast.projection = Projection::maximum;
  EXPECT_EQ(provenance(d)["projection"], "mip");
  EXPECT_EQ(provenance(d)["shade"], false);
}

TEST(MakeScene, WhatAProvenanceRecordsIsReadBack) {
  Recipe built = description();
  built.transfer = "ct-bone";
  built.range = {20, 200};
  built.light_rig = built_in_rigs().back().name;
  built.light = glm::dvec3(0, -1, 0);
  built.raycast.step = 1;
  built.raycast.lighting.samples = 3;
  built.raycast.lighting.linear = true;
  built.labels_volume.volume = ball();
  nlohmann::json expected = provenance(built);

  Recipe truth = description();
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
  Recipe d;
  d.input = "scene:balls";
  EXPECT_TRUE(make_scene(d));
  d.mask.path = "mask.nii";
  const auto scene = make_scene(d);
  ASSERT_FALSE(scene);
  EXPECT_THAT(scene.error().message, HasSubstr("mask: only for volumes"));
}

TEST(MakeScene, ChecksFilesBeforeItReadsThem) {
  Recipe d;
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

/// Two slabs of labels, 1 in front of 2, which is in front of 3, seen from -y.
Recipe slabs() {
  auto volume = std::make_shared<Volume>();
  volume->dims = {12, 12, 12};
  volume->labels = true;
  volume->source = "slabs";
  volume->label_styles = {{1, {"front", glm::dvec3(1, 0, 0)}},
                          {2, {"back", glm::dvec3(0, 1, 0)}},
                          {3, {"back", glm::dvec3(0, 0, 1)}}};
  for (int k = 0; k < 12 * 12 * 12; ++k) {
    const int y = k / 12 % 12;
    volume->voxels.push_back(static_cast<std::byte>(y < 2 || y > 9 ? 0
                                                    : y < 5        ? 1
                                                    : y < 7        ? 2
                                                                   : 3));
  }
  Recipe d;
  d.volume = std::move(volume);
  d.raycast.lighting.samples = 4;
  d.light_volume.deferred = true;
  return d;
}

TEST(MakeScene, OnlyLabelsAreShownUnderTheLightOfAll) {
  Recipe d = slabs();
  const auto all = make_scene(d);
  ASSERT_TRUE(all) << all.error().message;
  d.only_labels = {2, 3};
  const auto only = make_scene(d);
  ASSERT_TRUE(only) << only.error().message;
  EXPECT_EQ((*only)->bounds().center, (*all)->bounds().center);
  EXPECT_EQ((*only)->bounds().radius, (*all)->bounds().radius);
  EXPECT_EQ(provenance(d)["structures"]["only"], (std::vector{2, 3}));

  // The light of one is that of the other.
  ASSERT_TRUE((*all)->prepare());
  EXPECT_TRUE((*only)->set_light((*all)->light()));
  EXPECT_EQ((*only)->light(), (*all)->light());
  const auto from_front = [](const Scene& scene) {
    return scene.trace({5.5, -8, 5.5}, {5.5, 20, 5.5});
  };
  EXPECT_GT(from_front(**all).rgba.r, 0.3f);
  const RaySample behind = from_front(**only);
  EXPECT_EQ(behind.rgba.a, 1);
  EXPECT_EQ(behind.rgba.r, 0);
  EXPECT_GT(behind.depth, from_front(**all).depth + 0.05f);

  // Whether light was given or not, it is the same.
  const auto alone = make_scene(d);
  EXPECT_EQ(from_front(**alone).rgba, behind.rgba);

  Recipe truth = slabs();
  truth.truth_of = (*only)->provenance();
  EXPECT_EQ(provenance(truth)["structures"], provenance(d)["structures"]);
}

/// Calls `use` with a document in which one value has become another, for every value in it.
template <class Use>
void with_each_replaced(const nlohmann::json& document, const Use& use) {
  const nlohmann::json flat = document.flatten();
  for (const auto& [pointer, value] : flat.items())
    for (auto at = nlohmann::json::json_pointer(pointer); !at.empty(); at.pop_back())
      for (const nlohmann::json& other :
           std::vector<nlohmann::json>{nullptr, true, -1, 1e300, "?", {1, "?"}, {{"?", 1}}}) {
        nlohmann::json changed = document;
        changed[at] = other;
        use(changed);
      }
}

// What a field says of its source is free text.
TEST(MakeScene, ProvenancesOfAnyKindAreReadOrRefused) {
  Recipe built = slabs();
  built.only_labels = {2, 3};
  built.raycast.clip = {{{5, 5, 5}, {0, 0, 1}}};
  const nlohmann::json whole = provenance(built);
  with_each_replaced(whole, [&](const nlohmann::json& changed) {
    SCOPED_TRACE(changed.dump());
    Recipe d = slabs();
    d.truth_of = changed.dump();
    (void)raycast_options(d.truth_of);
    const auto scene = make_scene(d);
    if (!scene) {
      EXPECT_THAT(scene.error().message, Not(HasSubstr("json.exception")));
    }
  });
}

/// A dense ball, whole or cut open at z = 6.
Result<std::unique_ptr<Scene>> dense_ball(bool cut, const std::string& truth_of = {}) {
  Recipe d = description();
  if (truth_of.empty()) {
    d.raycast.lighting.samples = 4;
    d.range = {20, 60};
    if (cut) d.raycast.clip = {{glm::dvec3(5.5, 5.5, 6), glm::dvec3(0, 0, 1)}};
  }
  d.truth_of = truth_of;
  return make_scene(d);
}

TEST(MakeScene, OneLightServesScenesThatAreCut) {
  const std::shared_ptr<const Scene> whole = std::move(*dense_ball(false));
  const auto own = dense_ball(true), cut = dense_ball(true);
  ASSERT_TRUE(own && cut);
  ASSERT_TRUE((*cut)->share_light(whole));
  ASSERT_TRUE((*own)->prepare() && (*cut)->prepare());
  // Far from the cut, the light is that of the whole ball; the face has its own.
  const auto from = [](const Scene& scene, const glm::dvec3& eye) {
    return scene.trace(eye, glm::dvec3(5.5) + 0.8 * (glm::dvec3(5.5) - eye)).rgba;
  };
  const glm::dvec3 below(5, 6, -12), above(5, 6, 20), aside(-9, 5, -4);
  EXPECT_EQ(from(**cut, below), from(*whole, below));
  EXPECT_NE(from(**cut, above), from(*whole, above));
  EXPECT_NEAR(from(**cut, above).r, from(**own, above).r, 0.1);
  EXPECT_GT(from(**cut, above).r, 0.2);
  EXPECT_NE(from(**own, aside), from(*whole, aside));
  EXPECT_EQ(from(**cut, aside), from(*whole, aside));
  EXPECT_EQ((*cut)->light(), whole->light());

  // The provenance tells whose light it is, and takes the light that a field keeps.
  const auto told = nlohmann::json::parse((*cut)->provenance());
  EXPECT_EQ(told["light_of"], (nlohmann::json{{"clip", nlohmann::json::array()}}));
  nlohmann::json stored;  // as a manifest stores states
  stored.merge_patch(told);
  EXPECT_EQ(stored, told);
  const auto again = dense_ball(true, stored.dump());
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_TRUE((*again)->set_light(whole->light()));
  const auto whole_again = dense_ball(false, whole->provenance());
  ASSERT_TRUE((*whole_again)->set_light(whole->light()));
  EXPECT_EQ(from(**again, below), from(**whole_again, below));
  EXPECT_NEAR(from(**again, above).r, from(**cut, above).r, 0.01);  // its step is finer
}

/// A shell with a small hole in its side, whole or without its top.
Result<std::unique_ptr<Scene>> shell_with_hole(bool cut) {
  auto volume = std::make_shared<Volume>();
  volume->dims = {32, 32, 32};
  volume->source = "shell";
  for (int z = 0; z < 32; ++z)
    for (int y = 0; y < 32; ++y)
      for (int x = 0; x < 32; ++x) {
        const glm::dvec3 at = glm::dvec3(x, y, z) - 15.5;
        const bool hole = at.x > 0 && glm::length(glm::dvec2(at.y, at.z)) < 2;
        const double off = std::abs(glm::length(at) - 11);
        volume->voxels.push_back(static_cast<std::byte>(hole ? 0 : std::max(0.0, 250 - 60 * off)));
      }
  Recipe d;
  d.volume = volume;
  d.range = {20, 60};
  d.raycast.lighting.samples = 16;
  if (cut) d.raycast.clip = {{glm::dvec3(15.5, 15.5, 19), glm::dvec3(0, 0, 1)}};
  return make_scene(d);
}

TEST(MakeScene, ACavityThatACutOpensHasItsOwnLight) {
  const std::shared_ptr<const Scene> whole = std::move(*shell_with_hole(false));
  const auto own = shell_with_hole(true), cut = shell_with_hole(true);
  ASSERT_TRUE(own && cut);
  ASSERT_TRUE((*cut)->share_light(whole));
  ASSERT_TRUE((*own)->prepare() && (*cut)->prepare());
  double squares = 0;
  for (int y = -6; y <= 6; ++y)
    for (int x = -6; x <= 6; ++x) {
      const glm::dvec3 eye(15.5 + x, 15.5 + y, 60), to(15.5 + x, 15.5 + y, 0);
      const glm::vec4 difference = (*own)->trace(eye, to).rgba - (*cut)->trace(eye, to).rgba;
      squares += glm::dot(difference, difference);
    }
  EXPECT_GT(-10 * std::log10(squares / (13 * 13 * 3)), 26);
}

TEST(MakeScene, OneLightServesAMaskedSceneAndTheWhole) {
  const std::shared_ptr<const Scene> whole = std::move(*dense_ball(false));
  Recipe d = description();
  d.raycast.lighting.samples = 4;
  d.range = {20, 60};
  d.mask.volume = ball();
  const auto masked = make_scene(d);
  ASSERT_TRUE(masked && (*masked)->share_light(whole));
  ASSERT_TRUE(whole->prepare());
  Recipe truth = description();
  truth.mask = d.mask;
  truth.truth_of = (*masked)->provenance();
  const auto again = make_scene(truth);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_TRUE((*again)->set_light(whole->light()));  // which no mask has changed
}

TEST(MakeScene, RefusesTheLightOfAnUnlikeScene) {
  const auto refusal = [](const Recipe& d, std::shared_ptr<const Scene> from) {
    const auto scene = make_scene(d);
    EXPECT_TRUE(scene);
    const auto shared = (*scene)->share_light(std::move(from));
    return shared ? "" : shared.error().message;
  };
  const std::shared_ptr<const Scene> whole = std::move(*dense_ball(false));
  const std::shared_ptr<const Scene> cut = std::move(*dense_ball(true));
  Recipe d = description();
  EXPECT_THAT(refusal(d, whole), HasSubstr("but /lighting/samples differs"));
  d.raycast.lighting.samples = 4;
  EXPECT_THAT(refusal(d, whole), HasSubstr("/transfer"));
  d.range = {20, 60};
  EXPECT_EQ(refusal(d, whole), "");
  EXPECT_THAT(refusal(d, cut), HasSubstr("reaches out of the box"));
  ASSERT_TRUE(cut->share_light(whole));
  EXPECT_THAT(refusal(d, cut), HasSubstr("the light of a third"));
  d.lighting = Lighting::direct;
  EXPECT_THAT(refusal(d, whole), HasSubstr("only volumes under"));
  d = Recipe();
  d.input = "scene:balls";
  EXPECT_THAT(refusal(d, whole), HasSubstr("only volumes under"));
}

using Bits = std::array<std::uint32_t, 5>;

/// What rays from several sides show, to the bit.
std::vector<Bits> views_of(const Scene& scene) {
  std::vector<Bits> seen;
  for (const glm::dvec3& eye : {glm::dvec3(5, 6, -12), {5, 6, 20}, {-9, 5, -4}, {7, -9, 8}}) {
    const RaySample sample = scene.trace(eye, glm::dvec3(5.5) + 0.8 * (glm::dvec3(5.5) - eye));
    seen.push_back(std::bit_cast<Bits>(sample));
  }
  return seen;
}

TEST(MakeScene, PartsHaveTheUnitOfTheVolume) {
  Recipe d = description();
  auto volume = std::make_shared<Volume>(*d.volume);
  auto labels = std::make_shared<Volume>(*slabs().volume);
  volume->unit = labels->unit = "\u00b5m";
  d.volume = volume;
  d.labels_volume.volume = labels;
  const auto same = make_scene(d);
  ASSERT_TRUE(same) << same.error().message;
  auto other = std::make_shared<Volume>(*labels);
  other->unit = "mm";
  other->axes *= 1e-3;
  other->origin *= 1e-3;
  d.labels_volume.volume = other;
  const auto scaled = make_scene(d);
  ASSERT_TRUE(scaled) << scaled.error().message;
  EXPECT_EQ(views_of(**scaled), views_of(**same));
  // One that states none is in millimetres, where it fits so.
  std::string said;
  d.on_note = [&](const std::string& text, const char*) { said += text + "\n"; };
  for (const bool fits : {true, false}) {
    auto none = std::make_shared<Volume>(fits ? *other : *labels);
    none->unit.clear();
    d.labels_volume.volume = none;
    said.clear();
    const auto guessed = make_scene(d);
    ASSERT_TRUE(guessed) << guessed.error().message;
    EXPECT_EQ(views_of(**guessed), views_of(**same));
    EXPECT_EQ(said.find("taken as millimetres") != said.npos, fits) << said;
  }
}

TEST(StateScenes, HaveTheUnitOfTheFirst) {
  StateScenes states;
  Recipe d = description();
  for (const char* unit : {"\u00b5m", "mm", ""}) {
    auto volume = std::make_shared<Volume>(*ball());
    volume->unit = unit;
    if (volume->unit == "mm") volume->axes *= 1e-3, volume->origin *= 1e-3;
    d.volume = volume;
    ASSERT_TRUE(states.add(concat("state ", unit), d));
  }
  for (const NamedScene& one : states.scenes())
    EXPECT_NEAR(one.scene->bounds().radius, states.scenes()[0].scene->bounds().radius, 1e-9);
}

TEST(StateScenes, AreThoseThatAreMadeAlone) {
  for (const ScalarType type : {ScalarType::u8, ScalarType::i32, ScalarType::f32}) {
    Recipe d = description();
    auto volume = std::make_shared<Volume>(*d.volume);
    if (type != ScalarType::u8) {  // the one is converted, the other has a value that is replaced
      std::vector<std::byte> wide(4 * volume->voxels.size());
      for (std::size_t k = 0; k < volume->voxels.size(); ++k) {
        const int value = std::to_integer<int>(volume->voxels[k]);
        const float real = k == 0 ? std::numeric_limits<float>::quiet_NaN() : float(value);
        std::memcpy(&wide[4 * k],
                    type == ScalarType::i32 ? static_cast<const void*>(&value) : &real, 4);
      }
      volume->type = type;
      volume->voxels = std::move(wide);
    }
    d.volume = volume;
    d.range = {20, 60};
    d.raycast.lighting.samples = 4;
    Recipe cut = d, parts = d, only = d, masked = d;
    cut.raycast.clip = {{glm::dvec3(5.5, 5.5, 6), glm::dvec3(0, 0, 1)}};
    parts.labels_volume.volume = slabs().volume;
    only = parts;
    only.only_labels = {1, 3};
    masked.mask.volume = slabs().volume;
    StateScenes states;
    for (const Recipe* one : {&d, &cut, &parts, &only, &masked, &d})
      ASSERT_TRUE(states.add("a", *one));
    const std::array all{&d, &cut, &parts, &only, &masked, &d};
    for (std::size_t k = 0; k < all.size(); ++k) {
      SCOPED_TRACE(k);
      const Scene& shared = *states.scenes()[k].scene;
      const auto alone = make_scene(*all[k]);
      ASSERT_TRUE(alone && (*alone)->prepare() && shared.prepare());
      EXPECT_EQ(shared.provenance(), (*alone)->provenance());
      EXPECT_EQ(shared.light(), (*alone)->light());
      EXPECT_EQ(views_of(shared), views_of(**alone));
    }
  }
}

TEST(StateScenes, ReadAFileOnce) {
  const std::string path = ::testing::TempDir() + "states.raw";
  const auto write = [&](char value) { std::ofstream(path) << std::string(512, value); };
  const auto content = [](const StateScenes& states) {
    return nlohmann::json::parse(states.scenes().back().scene->provenance())["content"];
  };
  write(100);
  Recipe d;
  d.input = path;
  d.reading.raw = {{{8, 8, 8}}};
  d.transfer = "ct-bone";
  d.range = {0, 50};
  d.lighting = Lighting::direct;
  int notes = 0;
  d.on_note = [&](const std::string&, const char*) { ++notes; };
  StateScenes states;
  ASSERT_TRUE(states.add("a", d));
  const auto first = content(states);
  write(101);
  d.raycast.clip = {{glm::dvec3(3, 3, 3), glm::dvec3(0, 0, 1)}};
  ASSERT_TRUE(states.add("b", d));
  EXPECT_EQ(content(states), first);
  EXPECT_LE(notes, 1);
  d.reading.spacing = glm::dvec3(2);  // another option: another reading
  ASSERT_TRUE(states.add("c", d));
  EXPECT_NE(content(states), first);
  std::filesystem::remove(path);
}

TEST(StateScenes, LightOfOneNeedsAnEarlierState) {
  Recipe d = description();
  d.raycast.lighting.samples = 4;
  StateScenes states;
  EXPECT_THAT(states.add("a", d, "b").error().message, HasSubstr("no earlier state is named 'b'"));
  EXPECT_TRUE(states.scenes().empty());
  ASSERT_TRUE(states.add("a", d) && states.add("b", d, "a"));
  EXPECT_THAT(states.add("c", d, "b").error().message, HasSubstr("the light of a third"));
}

TEST(StateScenes, AFileOfLightIsOfOneLight) {
  Recipe d = description();
  d.light_volume.file = ::testing::TempDir() + "one.light";
  StateScenes states;
  ASSERT_TRUE(states.add("a", d));
  Recipe brighter = d;
  brighter.raycast.lighting.tone.exposure = 1;  // which light does not depend on
  EXPECT_TRUE(states.add("b", brighter));
  Recipe other = d;
  other.raycast.lighting.samples = 5;
  const auto refused = states.add("c", other);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("has the light of state 'a'"));
  EXPECT_STREQ(refused.error().choice, "light_file");
  other.light_volume.file = ::testing::TempDir() + "{state}.light";
  EXPECT_TRUE(states.add("c", other) && states.add("d", d));
  other.light_volume.file = d.light_volume.file;
  other.lighting = Lighting::direct;
  EXPECT_TRUE(states.add("e", other));
}

TEST(StateScenes, ScenesOfOtherLabelsKeepTheirLight) {
  Recipe d = slabs();
  StateScenes states;
  ASSERT_TRUE(states.add("whole", d));
  d.raycast.clip = {{glm::dvec3(5.5, 5.5, 6), glm::dvec3(0, 0, 1)}};
  d.only_labels = {1};
  ASSERT_TRUE(states.add("own", d));
  d.only_labels = {2};
  ASSERT_TRUE(states.add("shared", d, "whole"));
  d.only_labels = {3};
  ASSERT_TRUE(states.add("own, too", d));
  for (const auto& [name, scene, recipe] : states.scenes()) ASSERT_TRUE(scene->prepare());
  const auto light = [&](std::size_t k) { return states.scenes()[k].scene->light(); };
  EXPECT_EQ(light(1), light(3));
  EXPECT_NE(light(1), light(0));
  EXPECT_EQ(light(2), light(0));
}

TEST(MakeScene, TheLightOfLabelsIsComputedOnce) {
  Recipe d = slabs();
  int begun = 0;
  std::uint64_t before = 0;
  d.light_volume.threads = 1;
  d.light_volume.progress = [&](const Progress& progress) {
    begun += before == 0 || progress.done < before;
    before = progress.done;
    return true;
  };
  const auto scenes = make_label_scenes(d);
  ASSERT_TRUE(scenes);
  ASSERT_EQ(scenes->size(), 2u);
  EXPECT_EQ(begun, 0);  // not before it is needed
  for (const auto& [name, scene, recipe] : *scenes) ASSERT_TRUE(scene->prepare());
  const int computed = begun;
  EXPECT_GT(computed, 0);
  const auto light = (*scenes)[0].scene->light();
  EXPECT_EQ((*scenes)[1].scene->light(), light);
  const auto again = make_label_scenes(d);
  ASSERT_TRUE(again && (*again)[0].scene->set_light(light));
  for (const auto& [name, scene, recipe] : *again) ASSERT_TRUE(scene->prepare());
  EXPECT_EQ(begun, computed);
  for (std::size_t k = 0; k < 2; ++k)
    EXPECT_EQ(views_of(*(*again)[k].scene), views_of(*(*scenes)[k].scene));
}

TEST(MakeScene, LabelsOfOneNameAreOneStructure) {
  Recipe d = slabs();
  using Groups = std::vector<std::pair<std::string, std::vector<int>>>;
  const auto groups = [&] {
    Groups out;
    const auto made = make_label_scenes(d);
    for (const auto& [name, scene, recipe] : *made)
      out.emplace_back(name, nlohmann::json::parse(scene->provenance())["structures"]["only"]);
    return out;
  };
  EXPECT_EQ(groups(), (Groups{{"front", {1}}, {"back", {2, 3}}}));
  d.only_labels = {3};
  EXPECT_EQ(groups(), (Groups{{"back", {3}}}));
  d.only_labels.clear();
  d.label_table = R"({"labels": [{"id": 1, "opacity": 0}, {"id": 3, "name": "third"}]})";
  EXPECT_EQ(groups(), (Groups{{"label 2", {2}}, {"third", {3}}}));
  // What is hidden in the table is so in the picture.
  const auto hidden = make_scene(d);
  ASSERT_TRUE(hidden);
  const auto shown = make_scene(slabs());
  const auto depth = [](const Scene& scene) {
    return scene.trace({5.5, -8, 5.5}, {5.5, 20, 5.5}).depth;
  };
  EXPECT_GT(depth(**hidden), depth(**shown) + 0.05f);

  d = description();
  EXPECT_THAT(make_label_scenes(d).error().message, HasSubstr("ball: holds amounts, not labels"));
  d.only_labels = {1};
  EXPECT_THAT(make_scene(d).error().message, HasSubstr("ball: has no labels"));
  d = slabs();
  d.only_labels = {7};
  EXPECT_EQ(make_scene(d).error().code, ErrorCode::failed);
}

}  // namespace
}  // namespace slf
