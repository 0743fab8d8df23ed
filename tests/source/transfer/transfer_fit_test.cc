// How transfer functions meet the values of a volume.
#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "tests/source/transfer/transfer_samples.h"

namespace slf {
namespace {

using samples::kMap;
using samples::parse;
using samples::ramp_volume;
using samples::volume_of;
using Values = TransferPreset::Values;

TEST(TransferPreset, ColorMapGetsOpacitiesAndTheRangeOfTheVolume) {
  const auto preset = parse(kMap);
  EXPECT_FALSE(preset.has_opacity);
  auto volume = ramp_volume();
  volume.axes = glm::dmat3(3.0);
  const auto transfer = preset.fit(volume);
  EXPECT_DOUBLE_EQ(transfer.colors.front().value, 0);
  EXPECT_DOUBLE_EQ(transfer.colors.back().value, 1000);
  EXPECT_EQ(transfer(0).w, 0);
  EXPECT_GT(transfer(1000).w, 0.9);
  EXPECT_NEAR(transfer(500).x, 0.5, 1e-9);
  EXPECT_NEAR(transfer.unit_distance, 3, 1e-12);
  // They are those of the volume's histogram, as without a colour map.
  const auto plain = default_transfer(volume);
  for (int value = 0; value <= 1000; value += 50)
    EXPECT_DOUBLE_EQ(transfer(value).w, plain(value).w) << value;
  // As it is, without a volume, it rises over its own extent.
  EXPECT_EQ(preset.function(-1).w, 0);
  EXPECT_DOUBLE_EQ(preset.function(1).w, 0.95);
}

TEST(TransferPreset, ColorMapInUnitsOfItsOwnStaysThere) {
  const auto transfer = parse(R"({"RGBPoints": [100, 0, 0, 1, 300, 1, 0, 0]})").fit(ramp_volume());
  EXPECT_EQ(transfer.colors.front().value, 100);
  EXPECT_EQ(transfer.colors.back().value, 300);
  EXPECT_EQ(transfer(0).w, 0);
}

TEST(TransferPreset, NormalizedOpacitiesAreStretchedWhereTheVolumeReachesFarBeyond) {
  const auto preset = parse(R"({"RGBPoints": [0, 0, 0, 1, 1, 1, 0, 0],
                                "Points": [0, 0, 0.5, 0, 0.5, 0, 0.5, 0, 1, 1, 0.5, 0]})");
  const auto wide = preset.fit(ramp_volume());
  EXPECT_EQ(wide(400).w, 0);
  EXPECT_NEAR(wide(750).w, 0.5, 1e-9);
  const auto narrow =
      preset.fit(volume_of(ScalarType::f32, std::vector<float>{0, 0.1f, 0.2f, 1.2f, 0, 0, 1, 0}));
  EXPECT_NEAR(narrow(0.75).w, 0.5, 1e-9);
  // In data units they stay, whatever the volume.
  const auto absolute = parse(R"({"RGBPoints": [0, 0, 0, 1, 2, 1, 0, 0],
                                  "Points": [0, 0, 0.5, 0, 2, 1, 0.5, 0]})");
  EXPECT_EQ(absolute.fit(ramp_volume())(2).w, 1);
}

TEST(TransferPreset, RangeOverrulesAll) {
  const std::array<double, 2> range{-200, 600};
  for (const std::string& text :
       {std::string(kMap), std::string(R"({"RGBPoints": [0, 0, 0, 1, 7, 1, 0, 0],
                                           "Points": [0, 0, 0.5, 0, 7, 1, 0.5, 0]})")}) {
    const auto transfer = parse(text).fit(ramp_volume(), range);
    EXPECT_DOUBLE_EQ(transfer.colors.front().value, -200);
    EXPECT_DOUBLE_EQ(transfer.colors.back().value, 600);
    EXPECT_EQ(transfer(-200).w, 0);
    EXPECT_GT(transfer(600).w, 0.9);
    EXPECT_GT(transfer(200).w, 0.1);
  }
  const auto indexed = parse(R"({"IndexedColors": [1, 0, 0, 0, 0, 1]})").fit(ramp_volume(), range);
  EXPECT_EQ(indexed(199).x, 1);
  EXPECT_EQ(indexed(201).z, 1);
}

TEST(TransferPreset, StretchedPointsStillAscendWithinTheRange) {
  const auto transfer = parse(R"({"RGBPoints": [-1511, 0, 0, 0, 401, 1, 0, 0],
                "Points": [-3.2222222222222223e+83, 0, 0.5, 0, 160, 0, 0.5, 0, 800, 0.8, 0.5, 0]})")
                            .fit(ramp_volume(), std::array<double, 2>{-3, 8});
  EXPECT_LE(transfer.opacities[1].value, 8);
  EXPECT_EQ(transfer.opacities[2].value, 8);
  EXPECT_LE(transfer.colors.back().value, 8);
  EXPECT_TRUE(parse_transfer(to_json(transfer), "again"));
}

TEST(TransferPreset, RangesOfTheSmallestNumbersDoNotVanish) {
  const double least = std::numeric_limits<double>::denorm_min();
  const auto transfer = parse(R"({"RGBPoints": [0, 0, 0, 1, 1, 1, 0, 0],
                                  "Points": [0, 0, 0.5, 0, 1, 1, 0.5, 0]})")
                            .fit(ramp_volume(), std::array<double, 2>{0, 2 * least});
  EXPECT_NEAR(transfer(least).w, 0.5, 1e-4);
}

TEST(TransferPreset, IndexedColorsAreCategoriesOrEvenSteps) {
  const auto preset = parse(R"({"Name": "Three", "IndexedColors": [1, 0, 0, 0, 1, 0, 0, 0, 1]})");
  EXPECT_EQ(preset.values, Values::indexed);
  auto labels = volume_of(ScalarType::u8, std::vector<std::uint8_t>{0, 1, 2, 3, 4, 5, 5, 5});
  labels.labels = true;
  const auto by_id = preset.fit(labels);
  EXPECT_EQ(by_id(0).w, 0);
  EXPECT_EQ(by_id(1), glm::dvec4(0, 1, 0, 1));
  EXPECT_EQ(by_id(2), glm::dvec4(0, 0, 1, 1));
  EXPECT_EQ(by_id(3), glm::dvec4(1, 0, 0, 1));  // round again
  const auto annotated =
      parse(R"({"IndexedColors": [1, 0, 0, 0, 1, 0], "Annotations": ["2", "two", "5", "five"]})");
  EXPECT_EQ(annotated.fit(labels)(5), glm::dvec4(0, 1, 0, 1));
  const auto steps = preset.fit(ramp_volume());
  EXPECT_EQ(steps(300).x, 1);
  EXPECT_EQ(steps(500).y, 1);
  EXPECT_EQ(steps(900).z, 1);
  EXPECT_EQ(steps(0).w, 0);
}

TEST(TransferPreset, LabelsGetTheColorsOfAMapInTheirOrder) {
  auto labels = volume_of(ScalarType::u8, std::vector<std::uint8_t>{0, 7, 7, 9, 9, 200, 200, 0});
  labels.labels = true;
  const auto transfer = parse(kMap).fit(labels);
  EXPECT_EQ(transfer(0).w, 0);
  EXPECT_EQ(transfer(7), glm::dvec4(0, 0, 1, 1));
  EXPECT_EQ(transfer(200), glm::dvec4(1, 0, 0, 1));
}

std::vector<float> signed_map() {
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0, 1);
  std::vector<float> values(12000, 0);
  for (std::size_t i = 4000; i < 8000; ++i) values[i] = noise(random);
  for (std::size_t i = 5000; i < 5100; ++i) values[i] = 7;
  for (std::size_t i = 6000; i < 6100; ++i) values[i] = -6;
  return values;
}

TEST(TransferPreset, DefaultOfASignedMapClearsZeroAndShowsBothSigns) {
  const auto volume = volume_of(ScalarType::f32, signed_map());
  const auto transfer = default_transfer(volume);
  EXPECT_EQ(transfer(0).w, 0);
  EXPECT_GT(transfer(7).w, 0.8);
  EXPECT_GT(transfer(-6).w, 0.5);
  EXPECT_LT(transfer(1).w, 0.1);
  EXPECT_GT(transfer(6).x, transfer(6).z);    // red to yellow
  EXPECT_GT(transfer(-6).z, transfer(-6).x);  // blue to cyan
  EXPECT_TRUE(parse_transfer(to_json(transfer), "again"));
  // A colour map has its middle at 0.
  const auto mapped = parse(kMap).fit(volume);
  EXPECT_NEAR(mapped(0).x, mapped(0).z, 1e-9);
  EXPECT_EQ(mapped(0).w, 0);
}

TEST(TransferPreset, DefaultOfHounsfieldUnitsIsNotTakenForASignedMap) {
  std::vector<std::int16_t> values(6000, -1000);
  std::mt19937 random(1);
  std::normal_distribution<float> tissue(20, 40);
  for (std::size_t i = 3000; i < 5500; ++i) values[i] = static_cast<std::int16_t>(tissue(random));
  for (std::size_t i = 5500; i < 6000; ++i) values[i] = 900;
  const auto transfer = default_transfer(volume_of(ScalarType::i16, values));
  EXPECT_EQ(transfer(-1000).w, 0);
  EXPECT_GT(transfer(900).w, 0.9);
}

// Most of a PET is air, some body, and a few organs are a hundred times as bright as that.
TEST(TransferPreset, DefaultOfPetShowsTheBodyToo) {
  // Many reconstructions clip air at 0; with zeros, values are not taken by decades.
  for (const bool clipped : {false, true}) {
    SCOPED_TRACE(clipped);
    std::mt19937 random(1);
    std::exponential_distribution<float> air(1 / 20.0f);
    std::normal_distribution<float> body(1000, 200), organ(20000, 4000);
    std::vector<float> values(40000);
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = i < 30000 ? air(random) : i < 39700 ? body(random) : organ(random);
    for (std::size_t i = 0; clipped && i < 30000; i += 2) values[i] = 0;
    const auto transfer = default_transfer(volume_of(ScalarType::f32, values));
    EXPECT_EQ(transfer(60).w, 0);
    EXPECT_GT(transfer(1000).w, clipped ? 0.001 : 0.003);
    EXPECT_LT(transfer(1000).w, 0.5);
    EXPECT_GT(transfer(25000).w, 0.7);
  }
}

TEST(TransferPreset, IdsLookLikeLabelsAndAmountsDoNot) {
  std::vector<std::uint8_t> ids(64 * 64), noise(64 * 64), smooth(64 * 64), mask(64 * 64);
  std::mt19937 random(1);
  for (std::size_t i = 0; i < ids.size(); ++i) {
    const std::size_t x = i % 64, y = i / 64;
    ids[i] = x < 8 ? 0 : static_cast<std::uint8_t>(40 + 17 * (x / 12) + 23 * (y / 20));
    noise[i] = static_cast<std::uint8_t>(100 + random() % 5);
    smooth[i] = static_cast<std::uint8_t>(x + y);
    mask[i] = x > 10 && x < 50 ? 255 : 0;
  }
  EXPECT_TRUE(looks_like_labels(volume_of(ScalarType::u8, ids, 64)));
  EXPECT_TRUE(looks_like_labels(volume_of(ScalarType::u8, mask, 64)));
  EXPECT_FALSE(looks_like_labels(volume_of(ScalarType::u8, noise, 64)));
  EXPECT_FALSE(looks_like_labels(volume_of(ScalarType::u8, smooth, 64)));
  auto scaled = volume_of(ScalarType::u8, ids, 64);
  scaled.slope = 0.5;
  EXPECT_FALSE(looks_like_labels(scaled));
  EXPECT_TRUE(looks_like_labels(
      volume_of(ScalarType::f32, std::vector<float>(ids.begin(), ids.end()), 64)));
}

}  // namespace
}  // namespace slf
