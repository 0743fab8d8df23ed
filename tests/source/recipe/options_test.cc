#include "source/recipe/options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/temporary_folder.h"

namespace slf::recipe {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

/// A value of the type, other than any default.
json value_of(const Type& type) {
  using Form = Type::Form;
  const auto numbers = [&](std::size_t count) { return json(std::vector<double>(count, 2.0)); };
  switch (type.form) {
    case Form::flag:
      return true;
    case Form::whole:
      return type.low > 3 ? type.low : 3;
    case Form::number:
      return type.high < 3 ? 0.75 : 3.5;
    case Form::bytes:
      return "77MiB";
    case Form::text:
      return "text";
    case Form::file:
      return "file.x";
    case Form::choice:
      return type.names.back();
    case Form::numbers:
    case Form::wholes:
      return numbers(type.count == 0 ? 2 : type.count);
    case Form::planes:
      return json::array({numbers(6)});
    case Form::box:
      return {{1, 2}, {nullptr, 3}, {4, nullptr}};
  }
  return {};
}

TEST(Options, EachIsSetReadBackAndReset) {
  for (const Option& option : options()) {
    Recipe recipe;
    const json before = option.get(recipe), value = value_of(option.type);
    const auto ok = set(recipe, option.name, value);
    ASSERT_TRUE(ok) << ok.error().message;
    const json found = option.get(recipe);
    EXPECT_FALSE(found.is_null()) << option.name;
    EXPECT_TRUE(recipe.stated.contains(option.name));
    // What was read back sets the same.
    Recipe again;
    ASSERT_TRUE(set(again, option.name, found)) << option.name << ": " << found;
    EXPECT_EQ(option.get(again), found) << option.name;
    ASSERT_TRUE(set(recipe, option.name, nullptr));
    EXPECT_EQ(option.get(recipe), before) << option.name;
    EXPECT_TRUE(recipe.stated.empty());
  }
}

TEST(Options, TextStandsForValues) {
  Recipe recipe;
  ASSERT_TRUE(set(recipe, "range", "10,200"));
  EXPECT_EQ((*recipe.range)[1], 200);
  ASSERT_TRUE(set(recipe, "dims", "4x5x6"));
  EXPECT_EQ(recipe.raw.dims[2], 6u);
  ASSERT_TRUE(set(recipe, "type", "unsigned short"));
  EXPECT_EQ(recipe.raw.type, ScalarType::u16);
  ASSERT_TRUE(set(recipe, "crop", "10:200,:,50:"));
  EXPECT_EQ(recipe.reading.crop->end[0], 200u);
  EXPECT_EQ(recipe.reading.crop->begin[2], 50u);
  ASSERT_TRUE(set(recipe, "light_memory", "64MiB"));
  EXPECT_EQ(recipe.raycast.lighting.memory, 64u << 20);
  ASSERT_TRUE(set(recipe, "clip", "0,0,40,0,0,1"));
  EXPECT_EQ(recipe.raycast.clip.front().point.z, 40);
}

TEST(Options, RefusesOtherTypesAndRanges) {
  const std::vector<std::pair<const char*, json>> wrong{{"step", 0.01},
                                                        {"step", "NaN"},
                                                        {"step", json::array({1})},
                                                        {"labels", "yes"},
                                                        {"labels", 1},
                                                        {"component", -1},
                                                        {"component", 1.5},
                                                        {"range", {1}},
                                                        {"range", {1, "x"}},
                                                        {"projection", "max"},
                                                        {"crop", "1:2,3"},
                                                        {"crop", "1:2,3:4,5:x"},
                                                        {"clip", {1, 2, 3}},
                                                        {"light_memory", "x"},
                                                        {"transfer", 7},
                                                        {"dims", {0, 1, 1}},
                                                        {"dims", "4x5"},
                                                        {"light_seed", -1},
                                                        {"crop", {{0, 0}, {0, 1}, {0, 1}}}};
  for (const auto& [name, value] : wrong) {
    Recipe recipe;
    const auto ok = set(recipe, name, value);
    ASSERT_FALSE(ok) << name << " = " << value;
    EXPECT_EQ(ok.error().code, ErrorCode::usage);
    EXPECT_THAT(ok.error().message, HasSubstr("expected"));
    EXPECT_THAT(ok.error().message, HasSubstr(name));
  }
}

TEST(Options, WhatDoesNotApplyToASourceIsRefused) {
  const std::vector<std::pair<const char*, Kind>> sources{
      {"a.nii", kVolume}, {"a.glb", kMesh}, {"pictures:a", kPictures}, {"scene:balls", kAnalytic}};
  for (const auto& [input, kind] : sources)
    for (const Option& option : options()) {
      Recipe recipe;
      recipe.input = input;
      ASSERT_TRUE(set(recipe, option.name, value_of(option.type)));
      if (option.use == Use::input) continue;
      if (option.needs) {
        ASSERT_TRUE(set(recipe, option.needs, value_of(find(option.needs)->type)));
      }
      const auto applies = check_applies(recipe);
      EXPECT_EQ(bool(applies), (option.kinds & kind) != 0) << option.name << " of " << input;
      if (!applies) {
        EXPECT_THAT(applies.error().message, HasSubstr("only for"));
      }
    }
}

TEST(RecipeFiles, PathsAreRelativeToTheRecipe) {
  const testing::TemporaryFolder folder;
  testing::write_text(folder / "r.json", R"({"input": "a.nii", "transfer": "ct-bone",
    "label_table": "/x/t.txt", "light_rig": {"lights": []}, "states": [
      {"name": "b", "mask": "m.nii", "no-such": 1}]})");
  Recipe recipe;
  auto ok = read_recipe(folder / "r.json", recipe);
  ASSERT_FALSE(ok);
  EXPECT_EQ(ok.error().code, ErrorCode::bad_file);
  EXPECT_THAT(ok.error().message, HasSubstr("states[0]: 'no_such' is no option"));
  testing::write_text(folder / "r.json", R"({"input": "a.nii", "transfer": "ct-bone",
    "label_table": "/x/t.txt", "light_rig": {"lights": []}, "step": 1,
    "states": [{"name": "a"}, {"name": "b", "mask": "m.nii", "transfer": null}]})");
  recipe = Recipe();
  ASSERT_TRUE(set(recipe, "step", 0.5));
  ok = read_recipe(folder / "r.json", recipe);
  ASSERT_TRUE(ok) << ok.error().message;
  EXPECT_EQ(recipe.input, folder / "a.nii");
  EXPECT_EQ(recipe.transfer, "ct-bone");
  EXPECT_EQ(recipe.label_table, "/x/t.txt");
  EXPECT_EQ(recipe.light_rig, R"({"lights":[]})");
  EXPECT_EQ(recipe.raycast.step, 0.5);  // what was stated before stands
  ASSERT_EQ(recipe.states.size(), 2u);
  EXPECT_EQ(recipe.states[1].name, "b");
}

}  // namespace
}  // namespace slf::recipe
