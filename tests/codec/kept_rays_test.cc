// Tiles that keep rays of the same tile of an earlier state.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "codec/predictive_codec.h"
#include "tests/codec/sample_tiles.h"

namespace slf::codec {
namespace {

/// A tile of level 0, and the same in which some rays show other things.
struct Pair {
  SampleTile first = make_tile(SampleFormat::rgba8_depth8, 21, 12, Content::disc);
  SampleTile second = make_tile(SampleFormat::rgba8_depth8, 21, 12, Content::disc);
  std::size_t count = first.tile.samples();
  std::vector<std::uint8_t> changed = std::vector<std::uint8_t>(count);

  /// The rays from one column on are those of another tile.
  explicit Pair(std::size_t column) {
    const SampleTile other = make_tile(SampleFormat::rgba8_depth8, 21, 12, Content::smooth);
    for (std::size_t s = 0; s < count; ++s) {
      if (s % first.tile.columns() < column) continue;
      std::copy_n(&other.samples[4 * s], 4, &second.samples[4 * s]);
      second.samples[4 * count + s] = other.samples[4 * count + s];
      changed[s] = 1;
    }
  }
};

struct KeptRaysTest : ::testing::Test {
  PredictiveCodec codec{{90}, predictive_tables({90}, 1)};

  Predicted predicted(std::size_t count, ByteSpan earlier) {
    alpha.assign(count, kUnpredictedAlpha), depth.assign(count, kUnpredictedDepth);
    color.assign(count, kUnpredictedColor);
    return {0, {}, {}, {alpha, depth, color}, kPlainScale, earlier};
  }
  Bytes encode(const SampleTile& tile, ByteSpan earlier = {}) {
    Bytes payload;
    const auto from = predicted(tile.tile.samples(), earlier);
    EXPECT_TRUE(codec.encode(tile.tile, tile.samples, &from, payload));
    return payload;
  }
  bool decode(const SampleTile& tile, ByteSpan payload, Bytes& samples, ByteSpan earlier = {}) {
    samples.resize(tile.tile.bytes());
    const auto from = predicted(tile.tile.samples(), earlier);
    return codec.decode(tile.tile, payload, &from, samples).has_value();
  }

  std::vector<std::uint8_t> alpha, depth;
  std::vector<std::uint32_t> color;
};

TEST_F(KeptRaysTest, ThoseThatAreEqualAreThoseOfTheEarlierTile) {
  for (const std::size_t column : {0, 1, 30, 60, 90, 91}) {
    const Pair pair(column);
    Bytes earlier, samples, alone;
    ASSERT_TRUE(decode(pair.first, encode(pair.first), earlier));
    const Bytes payload = encode(pair.second, earlier);
    ASSERT_TRUE(decode(pair.second, payload, samples, earlier));
    ASSERT_TRUE(decode(pair.second, encode(pair.second), alone));
    std::size_t kept = 0, equal = 0;
    double error = 0, error_alone = 0;
    for (std::size_t s = 0; s < pair.count; ++s) {
      const bool same = std::equal(&samples[4 * s], &samples[4 * s + 4], &earlier[4 * s]) &&
                        samples[4 * pair.count + s] == earlier[4 * pair.count + s];
      equal += pair.changed[s] ? 0 : 1, kept += !pair.changed[s] && same ? 1 : 0;
      for (std::size_t k = 4 * s; k < 4 * s + 4; ++k) {
        const auto off = [&](const Bytes& in) {
          const int d = std::to_integer<int>(in[k]) - std::to_integer<int>(pair.second.samples[k]);
          return double(d) * d;
        };
        error += off(samples), error_alone += off(alone);
      }
    }
    EXPECT_GE(kept, equal * 95 / 100) << column;
    EXPECT_LE(error, 1.5 * error_alone) << column;
    if (column >= 60) {
      EXPECT_LT(payload.size(), encode(pair.second).size()) << column;
    }
    if (column == 91) {
      EXPECT_LT(payload.size(), 80u);
    }
  }
}

// Views average noise away, but not an error that many rays have in common.
TEST_F(KeptRaysTest, ASmallChangeOfAllRaysIsCoded) {
  Pair pair(91);
  for (std::size_t s = 0; s < pair.count; ++s)
    for (std::size_t c = 0; c < 3; ++c)
      if (auto& value = pair.second.samples[4 * s + c]; std::to_integer<int>(value) >= 20)
        value = static_cast<std::byte>(std::to_integer<int>(value) - 9);
  Bytes earlier, samples;
  ASSERT_TRUE(decode(pair.first, encode(pair.first), earlier));
  ASSERT_TRUE(decode(pair.second, encode(pair.second, earlier), samples, earlier));
  double sum = 0;
  for (std::size_t k = 0; k < 4 * pair.count; ++k)
    sum += std::to_integer<int>(samples[k]) - std::to_integer<int>(pair.second.samples[k]);
  EXPECT_LT(std::abs(sum) / static_cast<double>(3 * pair.count), 1);
}

TEST_F(KeptRaysTest, DamageIsRefusedAndAnyPayloadDecodesWithoutHarm) {
  const Pair pair(60);
  Bytes earlier, samples;
  ASSERT_TRUE(decode(pair.first, encode(pair.first), earlier));
  const Bytes payload = encode(pair.second, earlier);
  for (std::size_t k = 0; k < payload.size(); ++k) {
    Bytes flipped = payload;
    flipped[k] ^= std::byte{16};
    (void)decode(pair.second, flipped, samples, earlier);
    EXPECT_FALSE(decode(pair.second, ByteSpan(payload).first(k), samples, earlier)) << k;
  }
  std::mt19937 random(5);
  for (int round = 0; round < 500; ++round) {
    Bytes noise(random() % 900);
    for (std::byte& byte : noise) byte = static_cast<std::byte>(random());
    (void)decode(pair.second, noise, samples, earlier);
  }
}

}  // namespace
}  // namespace slf::codec
