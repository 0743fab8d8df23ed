#include "codec/predictive.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "benchmarks/predictive_weights.h"
#include "tests/codec/sample_tiles.h"
#include "tests/instruction_set.h"

namespace slf::codec {
namespace {

/// A tile's true samples, and predictions that are near them.
struct Scene {
  std::vector<std::uint8_t> alpha, depth, predicted_alpha, predicted_depth;
  std::vector<std::uint32_t> rgba, predicted;
  std::vector<std::uint8_t> kinds, used;
};

std::uint32_t premultiplied(std::uint32_t r, std::uint32_t g, std::uint32_t b, std::uint32_t a) {
  const auto times = [&](std::uint32_t c) { return (c * a + 127) / 255; };
  return times(r) | times(g) << 8 | times(b) << 16 | a << 24;
}

Scene make_scene(const TileShape& tile, bool soft, std::uint32_t seed, int noise) {
  std::mt19937 random(seed);
  const auto near = [&](double v) {
    const int off = noise == 0 ? 0 : static_cast<int>(random() % (2u * noise + 1)) - noise;
    return static_cast<std::uint8_t>(std::clamp(static_cast<int>(v) + off, 0, 255));
  };
  Scene scene;
  for (std::size_t row = 0; row < tile.rows(); ++row)
    for (std::uint32_t q = 0; q <= tile.side; ++q)
      for (std::uint32_t p = 0; p + q <= tile.side; ++p) {
        const double x = p + 0.3 * row, y = q - 0.2 * row, n = tile.side + 1;
        const double inside = 0.4 * n - std::hypot(x - 0.4 * n, y - 0.3 * n);
        const double a = std::clamp(soft ? 12 * inside : 400 * inside, 0., 255.);
        const double wave = 100 + 80 * std::sin(0.4 * x) * std::cos(0.3 * y);
        scene.alpha.push_back(static_cast<std::uint8_t>(a));
        scene.depth.push_back(static_cast<std::uint8_t>(a > 0 ? 60 + 30 * std::sin(0.1 * x) : 0));
        scene.predicted_alpha.push_back(a > 0 && a < 255 ? near(a) : static_cast<std::uint8_t>(a));
        scene.predicted_depth.push_back(near(scene.depth.back()));
        const auto r = static_cast<std::uint32_t>(wave), g = r / 2 + 40, b = 255 - r;
        scene.rgba.push_back(premultiplied(r, g, b, scene.alpha.back()));
        scene.predicted.push_back(near(r) | std::uint32_t{near(g)} << 8 |
                                  std::uint32_t{near(b)} << 16 | 0xFF000000u);
      }
  for (std::size_t k = 0; k < 40; ++k) {
    scene.kinds.push_back(static_cast<std::uint8_t>(k % kReferenceKinds));
    scene.used.push_back(k % 7 == 0);
  }
  return scene;
}

struct Coded {
  Bytes payload;
  std::vector<std::uint8_t> depth;
  std::vector<std::uint32_t> rgba;
};

/// Whether the payload is accepted.
bool decode(const PredictiveLevel& level, const TileShape& tile, const Scene& scene,
            ByteSpan payload, Coded& out, std::vector<std::uint8_t>* used = nullptr,
            int scale = kPlainScale) {
  out = {{},
         std::vector<std::uint8_t>(scene.depth.size()),
         std::vector<std::uint32_t>(scene.rgba.size())};
  const TilePicture picture(tile);
  PredictiveDecoder decoder(level, scale, picture, payload);
  std::vector<std::uint8_t> flags(scene.kinds.size());
  decoder.references(scene.kinds, flags);
  if (used) *used = flags;
  return decoder
      .decode({scene.predicted_alpha, scene.predicted_depth, scene.predicted}, out.depth, out.rgba)
      .has_value();
}

/// The payload, and what it decodes to.
Coded encode(const PredictiveLevel& level, const TileShape& tile, const Scene& scene,
             int scale = kPlainScale) {
  const TilePicture picture(tile);
  Bytes payload;
  PredictiveEncoder encoder(level, scale, picture, payload);
  encoder.references(scene.kinds, scene.used);
  encoder.encode({scene.predicted_alpha, scene.predicted_depth, scene.predicted}, scene.depth,
                 scene.rgba);
  Coded coded;
  std::vector<std::uint8_t> used;
  EXPECT_TRUE(decode(level, tile, scene, payload, coded, &used, scale));
  EXPECT_EQ(used, scene.used);
  coded.payload = std::move(payload);
  return coded;
}

double psnr(const std::vector<std::uint32_t>& a, const std::vector<std::uint32_t>& b) {
  double sum = 0;
  for (std::size_t k = 0; k < a.size(); ++k)
    for (int shift = 0; shift < 24; shift += 8) {
      const double d = static_cast<double>(a[k] >> shift & 255) - (b[k] >> shift & 255);
      sum += d * d;
    }
  return 10 * std::log10(255. * 255 * 3 * static_cast<double>(a.size()) / (sum + 1e-9));
}

SampleTile shape(std::size_t rows, std::uint32_t side) {
  return make_tile(SampleFormat::rgba8, rows, side, Content::zero);
}

TEST(Predictive, WhatIsEncodedIsAccepted) {
  for (const int quality : {1, 60, 90, 100})
    for (const bool soft : {false, true})
      for (const std::size_t rows : {1, 2, 7, 45})
        for (const std::uint32_t side : {1, 4, 32}) {
          const PredictiveTables tables = predictive_tables({quality}, 1);
          const SampleTile sample = shape(rows, side);
          const Scene scene = make_scene(sample.tile, soft, 1, 9);
          SCOPED_TRACE(::testing::Message()
                       << quality << ", soft " << soft << ", " << rows << " rows, side " << side);
          const Coded coded = encode(tables.level(1), sample.tile, scene);
          if (quality == 100) {
            EXPECT_GT(psnr(coded.rgba, scene.rgba), 40);
          }
        }
}

/// Colours are coded after alpha, so they make up for its errors.
TEST(Predictive, ColorsOfSoftTilesDoNotSufferFromErrorsOfAlpha) {
  PredictiveLevel level = predictive_tables({99}, 1).level(1);
  const SampleTile sample = shape(7, 32);
  const Scene scene = make_scene(sample.tile, true, 1, 9);
  const double fine = psnr(encode(level, sample.tile, scene).rgba, scene.rgba);
  level.steps[kAlphaPlane] = {3000, 3000};
  EXPECT_GT(psnr(encode(level, sample.tile, scene).rgba, scene.rgba), fine - 6);
}

TEST(Predictive, NoColorExceedsItsAlpha) {
  const SampleTile sample = shape(7, 32);
  for (const int quality : {1, 60, 100}) {
    const PredictiveTables tables = predictive_tables({quality}, 1);
    const Coded coded = encode(tables.level(1), sample.tile, make_scene(sample.tile, true, 3, 40));
    for (std::size_t s = 0; s < coded.rgba.size(); ++s) {
      for (int shift = 0; shift < 24; shift += 8)
        ASSERT_LE(coded.rgba[s] >> shift & 255, coded.rgba[s] >> 24) << quality;
    }
  }
}

TEST(Predictive, QualityIsBoughtWithBytes) {
  const SampleTile sample = shape(36, 32);
  Scene scene = make_scene(sample.tile, false, 2, 12);
  for (std::size_t k = 0; k < scene.alpha.size(); ++k)  // its steps do not depend on quality
    if (scene.alpha[k] < 255) scene.alpha[k] = 0, scene.rgba[k] = 0;
  scene.predicted.assign(scene.predicted.size(), 0xFF808080u);
  std::size_t bytes = 0;
  double quality_before = 0;
  for (const int quality : {20, 50, 75, 90, 100}) {
    const PredictiveTables tables = predictive_tables({quality}, 0);
    const Coded coded = encode(tables.level(0), sample.tile, scene);
    EXPECT_GT(coded.payload.size(), bytes) << quality;
    EXPECT_GT(psnr(coded.rgba, scene.rgba), quality_before) << quality;
    bytes = coded.payload.size();
    quality_before = psnr(coded.rgba, scene.rgba);
  }
  EXPECT_GT(quality_before, 40);
}

TEST(Predictive, APerfectPredictionCostsAlmostNothing) {
  const SampleTile sample = shape(36, 32);
  const Scene scene = make_scene(sample.tile, false, 3, 0);
  const PredictiveTables tables = predictive_tables({90}, 1);
  const std::size_t near = encode(tables.level(1), sample.tile, scene).payload.size();
  const Scene off = make_scene(sample.tile, false, 3, 20);
  EXPECT_LT(4 * near, encode(tables.level(1), sample.tile, off).payload.size());
}

TEST(Predictive, AnyPayloadDecodesWithoutHarm) {
  const SampleTile sample = shape(5, 8);
  const Scene scene = make_scene(sample.tile, false, 4, 9);
  const PredictiveTables tables = predictive_tables({80}, 1);
  const Coded coded = encode(tables.level(1), sample.tile, scene);
  Coded back;
  for (std::size_t size = 0; size < coded.payload.size(); ++size)
    (void)decode(tables.level(1), sample.tile, scene, ByteSpan(coded.payload).first(size), back);
  for (std::size_t bit = 0; bit < 8 * coded.payload.size(); ++bit) {
    Bytes flipped = coded.payload;
    flipped[bit / 8] ^= static_cast<std::byte>(1 << bit % 8);
    (void)decode(tables.level(1), sample.tile, scene, flipped, back);
  }
  std::mt19937 random(5);
  for (int round = 0; round < 200; ++round) {
    Bytes noise(random() % 300);
    for (std::byte& byte : noise) byte = static_cast<std::byte>(random());
    (void)decode(tables.level(0), sample.tile, scene, noise, back);
  }
}

TEST(Predictive, DamagedPayloadsAreRefused) {
  const SampleTile sample = shape(9, 16);
  const Scene scene = make_scene(sample.tile, false, 6, 9);
  const PredictiveTables tables = predictive_tables({80}, 1);
  Coded coded = encode(tables.level(1), sample.tile, scene), back;
  for (const std::size_t size : {std::size_t{0}, std::size_t{1}, coded.payload.size() - 1})
    EXPECT_FALSE(
        decode(tables.level(1), sample.tile, scene, ByteSpan(coded.payload).first(size), back));
  for (std::size_t k = 0; k < coded.payload.size(); ++k) {
    Bytes flipped = coded.payload;
    flipped[k] ^= std::byte{16};
    EXPECT_FALSE(decode(tables.level(1), sample.tile, scene, flipped, back)) << k;
  }
  coded.payload.resize(coded.payload.size() + 20, std::byte{1});
  EXPECT_FALSE(decode(tables.level(1), sample.tile, scene, coded.payload, back));
}

/// A tile chooses the models that suit it.
TEST(Predictive, TilesAreCodedWithSeveralSetsOfModels) {
  const SampleTile sample = shape(45, 32);
  const PredictiveTables tables = predictive_tables({90}, 1);
  const auto bytes_with_one = [&](const Scene& scene, std::size_t set) {
    PredictiveLevel level = tables.level(1);
    const auto models = std::make_shared<PredictiveModels>(*level.models);
    models->blocks = {models->blocks[set]};
    models->block_sets = 1;
    for (LevelModels& of_level : models->levels)
      of_level.block_set.assign(kPlanes, SymbolModel(std::array<std::uint8_t, 2>{}));
    level.models = models;
    Coded coded = encode(level, sample.tile, scene), back;
    EXPECT_TRUE(decode(level, sample.tile, scene, coded.payload, back));
    EXPECT_EQ(back.rgba, coded.rgba);
    return coded.payload.size();
  };
  for (const int noise : {2, 12, 50}) {
    const Scene scene = make_scene(sample.tile, false, 7, noise);
    const std::size_t chosen = encode(tables.level(1), sample.tile, scene).payload.size();
    for (std::size_t set = 0; set < tables.level(1).models->block_sets; ++set)
      EXPECT_LE(chosen, bytes_with_one(scene, set) + 4) << noise << ", " << set;
  }
}

TEST(PredictiveTables, ComeBack) {
  const PredictiveTables tables = predictive_tables({77}, 3);
  const auto back = parse_predictive_tables(to_bytes(tables));
  ASSERT_TRUE(back);
  ASSERT_EQ(back->levels.size(), 4u);
  for (std::size_t l = 0; l < 4; ++l) EXPECT_EQ(back->level(l).steps, tables.level(l).steps);
  EXPECT_EQ(to_bytes(*back), to_bytes(tables));
}

TEST(PredictiveTables, DamageIsRefused) {
  Bytes bytes = to_bytes(predictive_tables({77}, 3));
  EXPECT_FALSE(parse_predictive_tables({}));
  EXPECT_FALSE(parse_predictive_tables(ByteSpan(bytes).first(bytes.size() - 1)));
  EXPECT_FALSE(parse_predictive_tables(ByteSpan(bytes).first(1)));
  Bytes longer = bytes;
  longer.push_back(std::byte{0});
  EXPECT_FALSE(parse_predictive_tables(longer));
  Bytes older = bytes;
  older[0] = std::byte{0};
  const auto refused = parse_predictive_tables(older);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("before"), std::string::npos) << refused.error().message;
  Bytes newer = bytes;
  newer[0] = std::byte{4};
  EXPECT_FALSE(parse_predictive_tables(newer));
  bytes[2] = bytes[3] = std::byte{0};  // a step
  EXPECT_FALSE(parse_predictive_tables(bytes));
}

TEST(PredictiveTables, ColorMatricesThatAreOfNoUseAreRefused) {
  const auto accepted = [](const ColorMatrix& matrix) {
    PredictiveTables tables = predictive_tables({77}, 3);
    for (PredictiveLevel& level : tables.levels) level.matrix = matrix;
    const auto parsed = parse_predictive_tables(to_bytes(tables));
    if (parsed) {
      EXPECT_EQ(parsed->level(2).matrix, matrix);
    }
    return parsed.has_value();
  };
  EXPECT_TRUE(accepted(kYcbcr));
  EXPECT_TRUE(accepted({256, 0, 0, 0, 256, 0, 0, 0, 256}));
  EXPECT_TRUE(accepted({-1024, 0, 0, 0, 1024, 0, 0, 0, 1024}));
  EXPECT_FALSE(accepted({}));
  EXPECT_FALSE(accepted({255, 0, 0, 0, 256, 0, 0, 0, 256}));
  EXPECT_FALSE(accepted({256, 256, 0, 256, 256, 0, 0, 0, 256}));
  EXPECT_FALSE(accepted({1025, 0, 0, 0, 1024, 0, 0, 0, 1024}));
  EXPECT_FALSE(accepted({-32768, 0, 0, 0, 1024, 0, 0, 0, 1024}));
}

/// Tables of releases up to 0.3 have no matrix.
TEST(PredictiveTables, ThoseOfVersion2AreRead) {
  PredictiveTables tables = predictive_tables({77}, 3);
  tables.plain = true;
  const Bytes bytes = to_bytes(tables);
  EXPECT_EQ(bytes[0], std::byte{2});
  EXPECT_EQ(bytes.size() + 18, to_bytes(predictive_tables({77}, 3)).size());
  const auto back = parse_predictive_tables(bytes);
  ASSERT_TRUE(back);
  EXPECT_TRUE(back->plain);
  EXPECT_EQ(back->level(1).matrix, kYcbcr);
  EXPECT_EQ(to_bytes(*back), bytes);
}

TEST(Predictive, ScaledStepsAreLimited) {
  const SampleTile sample = shape(7, 32);
  const Scene scene = make_scene(sample.tile, true, 1, 9);
  PredictiveLevel level = predictive_tables({90}, 1).level(1);
  std::size_t bytes = ~std::size_t{0};
  for (const int scale : {1, 5, 16, 40, 255}) {
    const std::size_t size = encode(level, sample.tile, scene, scale).payload.size();
    EXPECT_LT(size, bytes) << scale;
    bytes = size;
  }
  level.steps.fill({65535, 65535});
  EXPECT_EQ(level.steps_of(kYPlane, 255)[0], 65535);
  EXPECT_EQ(level.steps_of(kYPlane, 8)[63], 32768);
  level.steps.fill({1, 1});
  EXPECT_EQ(level.steps_of(kYPlane, 1)[0], 1);
  (void)encode(level, sample.tile, scene, 255);
}

/// Where tiles are coded sample by sample, there are no models of blocks to store.
TEST(PredictiveTables, ThoseOfSamplesAreSmall) {
  EXPECT_LT(to_bytes(predictive_tables({kLosslessQuality}, 3)).size(), 100u);
}

TEST(PredictiveTables, ProbabilitiesOfBytesRise) {
  for (int byte = 1; byte < 256; ++byte)
    EXPECT_LE(probability_of(static_cast<std::uint8_t>(byte - 1)),
              probability_of(static_cast<std::uint8_t>(byte)));
  for (const double p : {0.001, 0.1, 0.5, 0.93})
    EXPECT_NEAR(probability_of(bench::byte_of_probability(p)) / 65536., p, 0.005);
}

constexpr std::array<std::int32_t, 64> kUnitSteps = [] {
  std::array<std::int32_t, 64> steps{};
  for (std::int32_t& step : steps) step = 1;
  return steps;
}();

TEST(Dct, TheInverseUndoesTheTransform) {
  std::mt19937 random(8);
  for (int round = 0; round < 100; ++round) {
    std::array<float, 64> values;
    for (float& value : values) value = static_cast<float>(random() % 511) - 255;
    const std::array<float, 64> coefficients = forward_dct(values.data(), 8);
    Block rounded;
    for (std::size_t k = 0; k < 64; ++k)
      rounded[k] = static_cast<std::int16_t>(std::lround(coefficients[k]));
    std::int16_t pixels[64];
    restore_block(rounded, 64, kUnitSteps, pixels, 8);
    for (std::size_t k = 0; k < 64; ++k) EXPECT_NEAR(pixels[k], values[k], 1.5);
  }
}

TEST(Dct, AllInstructionSetsGiveTheSameFloats) {
  std::mt19937 random(11);
  std::array<float, 64> a, b, expected{};
  for (std::size_t k = 0; k < 64; ++k)
    a[k] = static_cast<float>(random()), b[k] = static_cast<float>(random()) - 2e9f;
  for (std::size_t y = 0; y < 8; ++y)
    for (std::size_t x = 0; x < 8; ++x)
      for (std::size_t k = 0; k < 8; ++k) expected[8 * y + x] += a[8 * y + k] * b[8 * k + x];
  slf::testing::with_each_instruction_set([&](const char* set) {
    std::array<float, 64> product;
    multiply(a.data(), 8, b.data(), 8, product);
    EXPECT_EQ(product, expected) << set;
  });
}

TEST(Dct, AllInstructionSetsAgreeWithTheDefinition) {
  constexpr int kBasis[8][8] = {
      {64, 64, 64, 64, 64, 64, 64, 64},     {89, 75, 50, 18, -18, -50, -75, -89},
      {83, 36, -36, -83, -83, -36, 36, 83}, {75, -18, -89, -50, 50, 89, 18, -75},
      {64, -64, -64, 64, 64, -64, -64, 64}, {50, -89, 18, 75, -75, -18, 89, -50},
      {36, -83, 83, -36, -36, 83, -83, 36}, {18, -50, 75, -89, 89, -75, 50, -18}};
  std::mt19937 random(9);
  for (int round = 0; round < 300; ++round) {
    Block block;
    for (auto& value : block) value = static_cast<std::int16_t>(random() >> (round % 12));
    int columns[64], expected[64];
    for (int x = 0; x < 8; ++x)
      for (int y = 0; y < 8; ++y) {
        int sum = 64;
        for (int k = 0; k < 8; ++k)
          sum += kBasis[k][y] * block[static_cast<std::size_t>(8 * k + x)];
        columns[8 * y + x] = std::clamp(sum >> 7, -32768, 32767);
      }
    for (int y = 0; y < 8; ++y)
      for (int x = 0; x < 8; ++x) {
        int sum = 2048;
        for (int k = 0; k < 8; ++k) sum += kBasis[k][x] * columns[8 * y + k];
        expected[8 * y + x] = static_cast<std::int16_t>(sum >> 12);
      }
    slf::testing::with_each_instruction_set([&](const char* set) {
      std::int16_t pixels[64];
      restore_block(block, 64, kUnitSteps, pixels, 8);
      for (std::size_t k = 0; k < 64; ++k) ASSERT_EQ(pixels[k], expected[k]) << set;
    });
  }
}

TEST(Dct, FewCoefficientsAndStepsChangeNothingButSpeed) {
  std::mt19937 random(10);
  for (std::size_t count = 0; count <= 64; ++count) {
    std::array<std::int32_t, 64> steps;
    for (std::int32_t& step : steps) step = static_cast<std::int32_t>(1 + random() % 3000);
    Block quantised{}, coefficients{};
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t at = kZigzag[k];
      quantised[at] = static_cast<std::int16_t>(static_cast<int>(random() % 101) - 50);
      coefficients[at] =
          static_cast<std::int16_t>(std::clamp(quantised[at] * steps[at], -32768, 32767));
    }
    slf::testing::with_each_instruction_set([&](const char* set) {
      std::int16_t pixels[64], expected[64];
      restore_block(quantised, count, steps, pixels, 8);
      restore_block(coefficients, 64, kUnitSteps, expected, 8);
      ASSERT_TRUE(std::ranges::equal(pixels, expected)) << set << ", " << count;
    });
  }
}

TEST(Dct, AMeanIsTheFirstCoefficient) {
  Block block{};
  block[0] = 8 * kCoefficientScale * 10;
  std::int16_t pixels[64];
  restore_block(block, 64, kUnitSteps, pixels, 8);
  for (const std::int16_t pixel : pixels) EXPECT_EQ(pixel, 10);
}

TEST(Dct, ExtremeCoefficientsStayWithinTheirIntegers) {
  Block block;
  std::int16_t pixels[64];
  for (int k = 0; k < 64; ++k) block[static_cast<std::size_t>(k)] = k % 2 ? 32767 : -32768;
  restore_block(block, 64, kUnitSteps, pixels, 8);
  block.fill(-32768);
  restore_block(block, 64, kUnitSteps, pixels, 8);
}

}  // namespace
}  // namespace slf::codec
