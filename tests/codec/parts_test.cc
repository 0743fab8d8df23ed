// Properties of the parts that codecs are made of.
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <vector>

#include "codec/fill.h"
#include "codec/jpeg_tables.h"
#include "codec/lane_samples.h"
#include "codec/lanes.h"
#include "tests/codec/sample_tiles.h"
#include "tests/instruction_set.h"

namespace slf::codec {
namespace {

RC_GTEST_PROP(ByteStreams, GiveBackFlatAreasWithNoise, ()) {
  const auto side = *rc::gen::inRange<std::uint32_t>(0, 12);
  const auto pictures = *rc::gen::inRange<std::size_t>(1, 40);
  const SampleTile sample = make_tile(SampleFormat::rgba8, pictures, side, Content::zero);
  Bytes alpha(sample.tile.samples());
  const auto values =
      *rc::gen::container<std::vector<std::uint8_t>>(rc::gen::element<std::uint8_t>(0, 255, 7));
  for (std::size_t i = 0; i < alpha.size() && !values.empty(); ++i)
    alpha[i] = static_cast<std::byte>(values[i / 7 % values.size()]);
  Bytes payload;
  RC_ASSERT(append_bytes(sample.tile, alpha, 9, payload).has_value());
  payload.push_back(std::byte{42});
  ByteSpan rest = payload;
  Bytes back(alpha.size());
  RC_ASSERT(read_bytes(sample.tile, rest, back).has_value());
  RC_ASSERT(back == alpha);
  RC_ASSERT(rest.size() == 1u);
}

TEST(ByteStreams, SpendNextToNothingOnFlatAlpha) {
  const SampleTile sample = make_tile(SampleFormat::rgba8, 45, 32, Content::zero);
  for (const std::byte value : {std::byte{0}, std::byte{255}}) {
    const Bytes alpha(sample.tile.samples(), value);
    Bytes payload;
    ASSERT_TRUE(append_bytes(sample.tile, alpha, 9, payload));
    EXPECT_LE(payload.size(), 64u);
  }
}

RC_GTEST_PROP(Lanes, RestoreUndoesPredictOnEveryMachine, ()) {
  const auto side = *rc::gen::inRange<std::uint32_t>(0, 9);
  const bool wide = *rc::gen::arbitrary<bool>();
  const auto channels = *rc::gen::inRange<std::size_t>(1, 4);
  const std::size_t columns = std::size_t{side + 1} * (side + 2) / 2;
  std::vector<ChannelPredictor> predictors(channels);
  for (ChannelPredictor& predictor : predictors) {
    predictor.linear = !wide;
    for (std::int16_t& weight : predictor.weights)
      weight = *rc::gen::inRange<std::int16_t>(-kMaxTapWeight, kMaxTapWeight + 1);
  }
  const LaneGroup group{side, wide ? 16u : 8u, predictors};
  std::vector<LaneValues> values(channels * columns), residuals(values.size()), back(values.size());
  std::vector<LaneValues> coverage(columns);
  const auto seed = *rc::gen::arbitrary<std::uint32_t>();
  std::uint32_t state = seed | 1;
  const auto random = [&] { return (state = state * 1664525 + 1013904223) >> 16; };
  for (LaneValues& lanes : values)
    for (std::uint16_t& value : lanes)
      value = static_cast<std::uint16_t>(random() & (wide ? 0xFFFF : 0xFF));
  for (LaneValues& lanes : coverage)
    for (std::uint16_t& value : lanes) value = random() % 4 != 0;

  std::vector<LaneValues> expected, expected_covered;
  slf::testing::with_each_instruction_set([&](const char*) {
    predict(group, values.data(), nullptr, residuals.data());
    restore(group, residuals.data(), back.data());
    RC_ASSERT(back == values);
    if (expected.empty()) expected = residuals;
    RC_ASSERT(residuals == expected);
    predict(group, values.data(), coverage.data(), residuals.data());
    if (expected_covered.empty()) expected_covered = residuals;
    RC_ASSERT(residuals == expected_covered);
  });

  predict(group, values.data(), coverage.data(), residuals.data());
  restore(group, residuals.data(), back.data());
  for (std::size_t i = 0; i < values.size(); ++i)
    for (std::size_t lane = 0; lane < kLaneCount; ++lane)
      if (coverage[i % columns][lane] != 0)
        RC_ASSERT(back[i][lane] == values[i][lane]);
      else
        RC_ASSERT(residuals[i][lane] == 0);
}

// The sum of 2^-length over all codes; 1 would use every code of the longest length.
double kraft(const HuffmanTable& table) {
  double sum = 0, unit = 1;
  for (const std::uint8_t count : table.counts) sum += count * (unit /= 2);
  return sum;
}

Result<JpegTables> parse(const JpegTables& tables) {
  const Bytes bytes = to_bytes(tables);
  ByteSpan from = bytes;
  return take_tables(from);
}

RC_GTEST_PROP(OptimalHuffman, GivesEverySymbolACode, ()) {
  SymbolCounts counts{};
  // Counts that grow like powers ask for codes far longer than 16 bits.
  const auto base = *rc::gen::inRange<std::uint64_t>(1, 4);
  std::uint64_t count = 1;
  for (int symbol = 0; symbol < 256; ++symbol)
    if (is_ac_symbol(symbol) && *rc::gen::inRange(0, 4) == 0)
      counts[static_cast<std::size_t>(symbol)] = count =
          std::min(count * base, std::uint64_t{1} << 40);
  const HuffmanTable table = optimal_huffman(counts, is_ac_symbol);
  RC_ASSERT(table.symbols.size() == 162u);
  RC_ASSERT(kraft(table) < 1.0);  // the code of all ones stays free
  JpegTables tables = standard_tables(75);
  tables.ac[0] = tables.ac[1] = table;
  RC_ASSERT(is_complete(tables));
  RC_ASSERT(parse(tables).has_value());
}

TEST(OptimalHuffman, GivesFrequentSymbolsShortCodes) {
  SymbolCounts counts{};
  counts[3] = 1000;
  counts[5] = 10;
  const HuffmanTable table = optimal_huffman(counts, is_dc_symbol);
  EXPECT_EQ(table.counts[0], 1);
  EXPECT_EQ(table.symbols[0], 3);
  EXPECT_EQ(table.symbols[1], 5);
}

TEST(JpegTables, RefusesWhatIsNoPrefixCode) {
  JpegTables tables = standard_tables(75);
  tables.dc[0].counts = {};
  tables.dc[0].counts[0] = 2;  // both codes of one bit, one of them all ones
  tables.dc[0].symbols = {0, 1};
  EXPECT_FALSE(parse(tables));
  tables.dc[0].counts[0] = 1;
  tables.dc[0].counts[1] = 1;
  EXPECT_TRUE(parse(tables));
  tables.dc[0].symbols = {1, 1};
  EXPECT_FALSE(parse(tables));
}

TEST(Fill, LeavesWhatMattersAlone) {
  std::vector<float> values(20 * 13, 99), weight(values.size());
  weight[45] = weight[130] = 1;
  values[45] = 10;
  values[130] = 30;
  fill(20, 13, weight, values);
  EXPECT_EQ(values[45], 10);
  EXPECT_EQ(values[130], 30);
  for (const float value : values) {
    EXPECT_GE(value, 10);
    EXPECT_LE(value, 30);
  }
}

/// What fill() does, pixel by pixel.
void fill_plainly(std::size_t width, std::size_t height, const std::vector<float>& weight,
                  std::vector<float>& values) {
  if (width * height <= 1 || std::ranges::count(weight, 0.f) == std::ssize(weight)) return;
  const std::size_t across = (width + 1) / 2, down = (height + 1) / 2;
  std::vector<float> means(across * down), total(means.size());
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x) {
      const std::size_t to = y / 2 * across + x / 2, from = y * width + x;
      means[to] += weight[from] * values[from];
      total[to] += weight[from];
    }
  for (std::size_t k = 0; k < means.size(); ++k) {
    if (total[k] > 0) means[k] /= total[k];
    total[k] = std::min(total[k], 1.f);
  }
  fill_plainly(across, down, total, means);
  const auto beside = [](std::size_t fine, std::size_t size) {
    return fine % 2 == 1 ? std::min(fine / 2 + 1, size - 1)
                         : std::max<std::size_t>(fine / 2, 1) - 1;
  };
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x) {
      const std::size_t u = x / 2, u2 = beside(x, across), k = y * width + x;
      const float *near = &means[y / 2 * across], *far = &means[beside(y, down) * across];
      const float mean = (9 * near[u] + 3 * near[u2] + 3 * far[u] + far[u2]) / 16;
      values[k] = weight[k] * values[k] + (1 - weight[k]) * mean;
    }
}

RC_GTEST_PROP(Fill, GivesTheFloatsOfItsDefinition, ()) {
  const auto width = *rc::gen::inRange<std::size_t>(1, 80);
  const auto height = *rc::gen::inRange<std::size_t>(1, 20);
  std::vector<float> values, weight;
  for (const auto byte : *rc::gen::container<std::vector<std::uint8_t>>(
           width * height, rc::gen::arbitrary<std::uint8_t>())) {
    values.push_back(static_cast<float>(byte) - 99);
    weight.push_back(byte % 3 == 0 ? 0.f : byte % 3 == 1 ? 1.f : static_cast<float>(byte) / 256);
  }
  std::vector<float> expected = values;
  fill_plainly(width, height, weight, expected);
  fill(width, height, weight, values);
  RC_ASSERT(values == expected);
}

TEST(Fill, WithoutAnyWeightChangesNothing) {
  std::vector<float> values(9, 5);
  const std::vector<float> weight(9);
  fill(3, 3, weight, values);
  EXPECT_EQ(values, std::vector<float>(9, 5));
}

}  // namespace
}  // namespace slf::codec
