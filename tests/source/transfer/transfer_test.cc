#include "slf/transfer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <set>

#include "slf/volume.h"
#include "source/transfer/transfer_color.h"

namespace slf {
namespace {

using Space = TransferFunction::Space;
using ::testing::HasSubstr;
using ::testing::StartsWith;

TransferFunction between(const glm::dvec3& a, const glm::dvec3& b, Space space) {
  TransferFunction transfer;
  transfer.space = space;
  transfer.colors = {{0, a}, {1, b}};
  transfer.opacities = {{0, 0, 0.5, 0}, {1, 1, 0.5, 0}};
  return transfer;
}

void expect_color(const glm::dvec4& rgba, const glm::dvec3& bytes) {
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(255 * rgba[i], bytes[i], 1) << i;
}

// What VTK 9's own test expects of its colour function from red to blue, at the middle.
TEST(Transfer, ColorSpacesAreThoseOfVtk) {
  const glm::dvec3 red(1, 0, 0), blue(0, 0, 1);
  expect_color(between(red, blue, Space::rgb)(0.5), {128, 0, 128});
  expect_color(between(red, blue, Space::hsv)(0.5), {255, 0, 255});
  expect_color(between(red, blue, Space::lab)(0.5), {202, 0, 136});
  expect_color(between(red, blue, Space::step)(0.5), {0, 0, 255});
  // Between two saturated colours of different hue lies white.
  const auto middle = between({0.23, 0.3, 0.75}, {0.7, 0.02, 0.15}, Space::diverging)(0.5);
  expect_color(middle, {221, 221, 221});
}

RC_GTEST_PROP(Transfer, ColorsSurviveTheWayThroughHsvAndLab, ()) {
  const auto channel = [] { return *rc::gen::inRange(0, 256) / 255.0; };
  const glm::dvec3 rgb(channel(), channel(), channel());
  namespace tc = transfer_color;
  RC_ASSERT(glm::length(tc::hsv_to_rgb(tc::rgb_to_hsv(rgb)) - rgb) < 1e-9);
  // VTK's matrices have four digits and are not quite each other's inverse.
  RC_ASSERT(glm::length(tc::lab_to_rgb(tc::rgb_to_lab(rgb)) - rgb) < 2e-2);
}

// vtkPiecewiseFunction: midpoint 0.25 halves at a quarter; sharpness 1 is a step there.
TEST(Transfer, MidpointAndSharpnessAreThoseOfVtk) {
  auto transfer = between({}, {}, Space::rgb);
  const auto opacity = [&](double value) { return transfer(value).w; };
  EXPECT_DOUBLE_EQ(opacity(0.3), 0.3);
  transfer.opacities[0].midpoint = 0.25;
  EXPECT_DOUBLE_EQ(opacity(0.25), 0.5);
  EXPECT_DOUBLE_EQ(opacity(0.125), 0.25);
  EXPECT_DOUBLE_EQ(opacity(0.625), 0.75);
  transfer.opacities[0].sharpness = 1;
  EXPECT_EQ(opacity(0.2499), 0);
  EXPECT_EQ(opacity(0.25), 1);
  // By hand for sharpness 0.5 at s = 0.25: s' = 0.5·0.5^6 = 1/128, then Hermite with slope 0.5.
  transfer.opacities[0] = {0, 0, 0.5, 0.5};
  const double s = 1.0 / 128, ss = s * s, sss = ss * s;
  EXPECT_NEAR(opacity(0.25), (3 * ss - 2 * sss) + 0.5 * (2 * sss - 3 * ss + s), 1e-15);
  EXPECT_DOUBLE_EQ(opacity(0.5), 0.5);
  EXPECT_DOUBLE_EQ(opacity(0.25) + opacity(0.75), 1);
}

TEST(Transfer, IsConstantBeyondItsEndsAndClearForNoNumber) {
  const auto transfer = between({1, 0, 0}, {0, 0, 1}, Space::rgb);
  EXPECT_EQ(transfer(-HUGE_VAL), glm::dvec4(1, 0, 0, 0));
  EXPECT_EQ(transfer(HUGE_VAL), glm::dvec4(0, 0, 1, 1));
  EXPECT_EQ(transfer(std::nan("")), glm::dvec4(0.0));
}

TEST(Transfer, TwoPointsAtOneValueAreAJump) {
  TransferFunction transfer = between({}, {}, Space::rgb);
  transfer.opacities = {{0, 0, 0.5, 0}, {1, 0, 0.5, 0}, {1, 0.5, 0.5, 0}, {2, 0.5, 0.5, 0}};
  EXPECT_EQ(transfer(1).w, 0);
  EXPECT_EQ(transfer(std::nextafter(1.0, 2.0)).w, 0.5);
}

constexpr const char* kPoints = R"("Points": [0, 0, 0.5, 0, 9, 1, 0.5, 0])";
constexpr const char* kColors = R"("RGBPoints": [0, 1, 0, 0, 9, 0, 0, 1])";

std::string preset(const std::string& colors, const std::string& points,
                   const std::string& more = "") {
  return "[{" + colors + (points.empty() ? "" : ", ") + points + more + "}]";
}

TEST(Transfer, ReadsAnArrayOrOnePreset) {
  const std::string alone = std::string("{") + kColors + ", " + kPoints + "}";
  for (const auto& text : {alone, "[" + alone + ", {}]"}) {
    const auto transfer = parse_transfer(text, "a.json");
    ASSERT_TRUE(transfer) << transfer.error().message;
    EXPECT_EQ(transfer->space, Space::rgb);
    EXPECT_EQ(transfer->unit_distance, 1);
    EXPECT_DOUBLE_EQ((*transfer)(4.5).w, 0.5);
  }
}

TEST(Transfer, SaysWhereAPresetIsWrong) {
  const auto expect = [](const std::string& text, const std::vector<std::string>& parts,
                         ErrorCode code = ErrorCode::bad_file) {
    const auto transfer = parse_transfer(text, "a.json");
    ASSERT_FALSE(transfer) << text;
    EXPECT_EQ(transfer.error().code, code);
    EXPECT_THAT(transfer.error().message, StartsWith("a.json: "));
    for (const auto& part : parts) EXPECT_THAT(transfer.error().message, HasSubstr(part));
  };
  expect("", {"not JSON"});
  expect("[{]", {"not JSON", "line 1", "column 3"});
  expect("[]", {"empty array"});
  expect("[3]", {"[0] is number", "expected a ParaView preset"});
  expect(preset(kColors, ""), {"[0].Points is missing"});
  expect("{" + std::string(kPoints) + "}", {"a.json: RGBPoints is missing"});
  expect(preset(kColors, R"("Points": [0, 0, 0.5])"), {"[0].Points is an array of 3", "opacity"});
  expect(preset(kColors, R"("Points": [])"), {"[0].Points is an array of 0"});
  expect(preset(kColors, R"("Points": {"a": 1})"), {"[0].Points is object"});
  expect(preset(kColors, R"("Points": [0,0,0.5,0, 9,1,0.5,0, 5,1,0.5,0])"),
         {"[0].Points[8] is 5", "ascend"});
  expect(preset(kColors, R"("Points": [0, "x", 0.5, 0])"), {"[0].Points[1] is string"});
  expect(preset(kColors, R"("Points": [0, 1.5, 0.5, 0])"), {"[0].Points[1] is 1.5", "0 to 1"});
  expect(preset(kColors, R"("Points": [NaN, 1, 0.5, 0])"), {"not JSON"});
  expect(preset(kColors, R"("Points": [1e999, 1, 0.5, 0])"), {"not JSON"});
  expect(preset(R"("RGBPoints": [0,1,0,0, 1,2,0,0])", kPoints), {"[0].RGBPoints[5] is 2"});
  expect(preset(kColors, kPoints, R"(, "ScalarOpacityUnitDistance": 0)"),
         {"ScalarOpacityUnitDistance is '0'", "positive"});
  expect(preset(kColors, kPoints, R"(, "ColorSpace": "XYZ")"),
         {"[0].ColorSpace is 'XYZ'", "Diverging"}, ErrorCode::unsupported);
  expect(std::string(100000, '['), {"not JSON"});
  for (const auto* path : {"/none.json", "/none.json#Name"}) {
    const auto missing = read_transfer(path);
    ASSERT_FALSE(missing);
    EXPECT_EQ(missing.error().code, ErrorCode::not_found);
  }
}

RC_GTEST_PROP(Transfer, SurvivesTheRoundTripThroughJson, ()) {
  const auto number = [] { return *rc::gen::arbitrary<double>(); };
  const auto unit = [] { return *rc::gen::inRange(0, 1001) / 1000.0; };
  TransferFunction transfer;
  transfer.name = "name \"quoted\"";
  transfer.space = static_cast<Space>(*rc::gen::inRange(0, 5));
  std::vector<double> values(*rc::gen::inRange<std::size_t>(1, 6));
  for (double& value : values) value = number();
  std::sort(values.begin(), values.end());
  for (const double value : values) {
    transfer.colors.push_back({value, {unit(), unit(), unit()}});
    transfer.opacities.push_back({value, unit(), unit(), unit()});
  }
  transfer.unit_distance = unit() + 0.125;
  const auto again = parse_transfer(to_json(transfer), "again");
  RC_ASSERT(again.has_value());
  RC_ASSERT(again->name == transfer.name && again->space == transfer.space);
  RC_ASSERT(again->unit_distance == transfer.unit_distance);
  RC_ASSERT(again->colors.size() == values.size() && again->opacities.size() == values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    RC_ASSERT(again->colors[i].value == values[i] &&
              again->colors[i].rgb == transfer.colors[i].rgb);
    RC_ASSERT(again->opacities[i].opacity == transfer.opacities[i].opacity);
    RC_ASSERT(again->opacities[i].midpoint == transfer.opacities[i].midpoint);
    RC_ASSERT(again->opacities[i].sharpness == transfer.opacities[i].sharpness);
    const auto a = transfer(values[i]), b = (*again)(values[i]);
    RC_ASSERT(a == b);
  }
}

TEST(Transfer, ReadsThePresetsOfTheDemo) {
  const std::filesystem::path folder = std::string(SLF_TEST_DATA) + "/../../scripts/data";
  int count = 0;
  for (const auto& file : std::filesystem::directory_iterator(folder)) {
    if (file.path().extension() != ".json") continue;
    ++count;
    const auto presets = read_transfers(file.path().string());
    ASSERT_TRUE(presets) << presets.error().message;
    for (const auto& preset : *presets) {
      EXPECT_FALSE(preset.function.name.empty());
      EXPECT_EQ(preset.function(preset.function.opacities.front().value).w, 0);
    }
  }
  EXPECT_GE(count, 2);
}

template <class T>
Volume volume_with(ScalarType type, const std::vector<T>& values) {
  Volume volume;
  volume.dims = {static_cast<std::uint32_t>(values.size() / 4), 2, 2};
  volume.type = type;
  volume.voxels.resize(values.size() * sizeof(T));
  std::memcpy(volume.voxels.data(), values.data(), volume.voxels.size());
  return volume;
}

TEST(Transfer, DefaultClearsAirAndShowsTissueInHounsfieldUnits) {
  std::vector<std::int16_t> stored(4000, -1000);
  std::fill(stored.begin() + 2400, stored.begin() + 3600, 40);
  std::fill(stored.begin() + 3600, stored.end(), 1200);
  auto volume = volume_with(ScalarType::i16, stored);
  volume.axes = glm::dmat3(2.0);
  const auto transfer = default_transfer(volume);
  EXPECT_EQ(transfer(-1000).w, 0);
  EXPECT_GT(transfer(40).w, 0);
  EXPECT_GT(transfer(1200).w, transfer(40).w);
  EXPECT_GT(transfer(1200).w, 0.9);
  EXPECT_NEAR(transfer.unit_distance, 2, 1e-12);
}

TEST(Transfer, DefaultSpacesPointsByDecadesWhereValuesSpanMany) {
  std::vector<float> densities;
  for (int i = 0; i < 4000; ++i)
    densities.push_back(std::pow(10.0f, -24.0f + 25.0f * float(i) / 4000));
  const auto transfer = default_transfer(volume_with(ScalarType::f32, densities));
  EXPECT_EQ(transfer(1e-20).w, 0);
  EXPECT_GT(transfer(1e-3).w, 0.05);
  EXPECT_LT(transfer(1e-3).w, 0.6);
  EXPECT_GT(transfer(9).w, 0.9);
}

TEST(Transfer, DefaultOfOneValueEverywhereIsClear) {
  const auto transfer =
      default_transfer(volume_with(ScalarType::u8, std::vector<std::uint8_t>(8, 7)));
  EXPECT_EQ(transfer(7).w, 0);
}

TEST(Transfer, DefaultOfLabelsIsAColorEachAndNothingBetween) {
  auto volume =
      volume_with(ScalarType::i16, std::vector<std::int16_t>{-3, 0, 0, 1, 2, 2, 900, 901});
  volume.labels = true;
  const auto transfer = default_transfer(volume);
  EXPECT_EQ(transfer(0).w, 0);
  std::set<std::vector<double>> colors;
  for (const double id : {-3, 1, 2, 900, 901}) {
    EXPECT_EQ(transfer(id).w, 1);
    const auto rgba = transfer(id);
    colors.insert({rgba.x, rgba.y, rgba.z});
  }
  EXPECT_EQ(colors.size(), 5);
  EXPECT_EQ(transfer(1.5), transfer(2));  // a step: never a mixture
}

TEST(Transfer, RefusesMoreJsonThanPresetsNeed) {
  std::string text = R"([{"Name": "a", "ColorSpace": "RGB", "RGBPoints": [0)";
  while (text.size() < (4u << 20)) text += ",0";
  const auto presets = parse_transfers(text + "]}]", "large.json");
  ASSERT_FALSE(presets);
  EXPECT_EQ(presets.error().code, ErrorCode::bad_file);
  EXPECT_THAT(presets.error().message, ::testing::HasSubstr("at most 4194304"));
}

}  // namespace
}  // namespace slf
