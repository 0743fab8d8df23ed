// A row that is added to the table of options is an option of all that options follow from. A
// program of its own, since the table is read once.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cli/command.h"
#include "tests/temporary_folder.h"

namespace slf {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

constexpr double kUsual = 1.5;
std::map<const Recipe*, double> sharpness;  // in place of a member

void add_row() {
  recipe::Option row = *recipe::find("step");
  row.name = "sharpness";
  row.help = "Of everything";
  row.kinds = recipe::kVolume;
  row.type.low = 0;
  row.type.high = 8;
  row.rare = false;
  row.otherwise.reset();
  row.set = [](Recipe& to, const json& value) {
    sharpness[&to] = value.is_null() ? kUsual : value.get<double>();
  };
  row.get = [](const Recipe& of) -> json {
    const auto found = sharpness.find(&of);
    return found == sharpness.end() ? kUsual : found->second;
  };
  recipe::table().push_back(std::move(row));
}

class Row : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { add_row(); }
  void SetUp() override { sharpness.clear(); }
};

TEST_F(Row, IsOnTheCommandLineAndInItsHelp) {
  cli::Run run;
  const auto app = cli::make_app(run);
  for (const char* command : {"build", "raycast"}) {
    const CLI::App* const found = app->get_subcommand(command);
    const std::string help = found->help("slf", CLI::AppFormatMode::All);
    EXPECT_THAT(help, HasSubstr("--sharpness NUMBER=1.5")) << command;
    EXPECT_THAT(help, HasSubstr("Of everything")) << command;
  }
  app->parse("raycast a.nii -o a.png --sharpness 2");
  ASSERT_EQ(sharpness.size(), 1u);
  EXPECT_EQ(sharpness.begin()->second, 2);
  EXPECT_THROW(cli::make_app(run)->parse("raycast a.nii -o a.png --sharpness 9"), CLI::ParseError);
  EXPECT_EQ(cli::hint_of("sharpness"), "see --sharpness");
}

TEST_F(Row, IsInTheSchemaAlsoOfStatesAndInPython) {
  const json members = recipe::schema(recipe::options())["properties"];
  EXPECT_EQ(members["sharpness"]["description"], "Of everything");
  EXPECT_EQ(members["sharpness"]["type"], "number");
  EXPECT_TRUE(members["states"]["items"]["properties"].contains("sharpness"));
  EXPECT_THAT(recipe::python_settings(recipe::options()),
              HasSubstr("    sharpness: float | None\n    \"\"\"Of everything.\"\"\"\n"));
}

TEST_F(Row, IsReadFromRecipesWrittenToThemAndCheckedInStates) {
  const testing::TemporaryFolder folder;
  testing::write_text(folder / "r.json", R"({"input": "a.nii", "sharpness": 3})");
  Recipe recipe;
  const auto ok = read_recipe(folder / "r.json", recipe);
  ASSERT_TRUE(ok) << ok.error().message;
  EXPECT_EQ(recipe::to_json(recipe)["sharpness"], 3);
  const auto wrong =
      recipe::add_states(recipe, json::parse(R"([{"name": "b", "sharpness": "x"}])"), "");
  ASSERT_FALSE(wrong);
  EXPECT_THAT(wrong.error().message, HasSubstr("sharpness"));
}

TEST_F(Row, IsRefusedWhereItDoesNotApply) {
  Recipe recipe;
  ASSERT_TRUE(recipe::set(recipe, "input", "a.ply"));
  ASSERT_TRUE(recipe::set(recipe, "sharpness", 3));
  const auto applies = recipe::check_applies(recipe);
  ASSERT_FALSE(applies);
  EXPECT_THAT(applies.error().message, HasSubstr("sharpness: only for volumes"));
  EXPECT_FALSE(recipe::set(recipe, "sharpness", -1));
  EXPECT_FALSE(recipe::set(recipe, "sharpnes", 1));
}

}  // namespace
}  // namespace slf
