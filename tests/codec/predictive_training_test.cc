#include "codec/predictive_training.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/codec/sample_tiles.h"

namespace slf::codec {
namespace {

/// Differences of colours along these axes, so far along each.
std::array<std::int64_t, 6> products_of(const std::array<std::array<double, 3>, 3>& axes,
                                        const std::array<double, 3>& spread) {
  std::array<std::int64_t, 6> products{};
  for (std::size_t a = 0, k = 0; a < 3; ++a)
    for (std::size_t b = a; b < 3; ++b, ++k)
      for (std::size_t axis = 0; axis < 3; ++axis)
        products[k] += std::llround(1e6 * spread[axis] * axes[axis][a] * axes[axis][b]);
  return products;
}

TEST(FitColors, FindsTheAxesOfDifferences) {
  // Those of a field, to three digits.
  const auto matrix = fit_colors(products_of(
      {{{0.54, 0.59, 0.60}, {-0.77, 0.06, 0.64}, {0.34, -0.80, 0.49}}}, {66, 3.39, 0.81}));
  const std::array<double, 9> expected{0.935,  -1.307, 0.58,  1.024, 0.1,
                                       -1.367, 1.037,  1.081, 0.828};
  for (std::size_t k = 0; k < 9; ++k) {
    const double sign = k % 3 == 1 && (matrix[1] > 0) ? -1 : 1;  // that of an axis is of no account
    EXPECT_NEAR(matrix[k], sign * 256 * expected[k], 8) << k;
  }
}

TEST(FitColors, AnyDifferencesGiveAMatrixThatTablesMayHold) {
  const double third = std::sqrt(1. / 3), half = std::sqrt(0.5), sixth = std::sqrt(1. / 6);
  const std::array<std::array<double, 3>, 3> grey{
      {{third, third, third}, {half, -half, 0}, {sixth, sixth, -2 * sixth}}};
  const std::array<std::array<double, 3>, 3> plain{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
  for (const auto& axes : {grey, plain})
    for (const std::array<double, 3>& spread : std::vector<std::array<double, 3>>{
             {1, 0, 0}, {5, 5, 5}, {5, 5, 0}, {5, 1, 1}, {1e-3, 0, 0}}) {
      const ColorMatrix matrix = fit_colors(products_of(axes, spread));
      EXPECT_NEAR(std::abs(static_cast<double>(determinant(matrix))) / (1 << 24), 5.0, 0.1);
      for (const std::int16_t element : matrix) EXPECT_LE(std::abs(element), kMaxMatrix);
    }
  EXPECT_EQ(fit_colors({}), kYcbcr);
}

class FitTables : public ::testing::Test {
 protected:
  /// Tiles that show much the same.
  std::vector<SampleTile> tiles(std::uint32_t seed, std::size_t count) const {
    std::mt19937 random(seed);
    std::vector<SampleTile> made;
    for (std::size_t k = 0; k < count; ++k) {
      SampleTile& tile = made.emplace_back(make_tile(SampleFormat::rgba8_depth8, 12, 16,
                                                     k % 2 == 0 ? Content::disc : Content::veil));
      for (std::size_t s = 0; s < tile.tile.samples(); ++s) {
        std::byte* const color = &tile.samples[4 * s];
        const auto less = static_cast<std::uint8_t>(random() % 40);
        for (std::size_t c = 0; c < 3; ++c) {  // along one axis
          const int value =
              std::to_integer<int>(color[3]) * 3 / 4 - static_cast<int>((c + 1) * less / 3);
          color[c] = static_cast<std::byte>(std::max(0, value));
        }
      }
    }
    return made;
  }
  Result<void> encode(const Codec& codec, const std::vector<SampleTile>& sample,
                      std::size_t* bytes = nullptr) const {
    Bytes payload;
    for (const SampleTile& tile : sample) {
      auto done = codec.encode(tile.tile, tile.samples, nullptr, payload);
      if (!done) return done;
      Bytes decoded(tile.samples.size());
      EXPECT_TRUE(codec.decode(tile.tile, payload, nullptr, decoded));
      if (bytes) *bytes += payload.size();
    }
    return {};
  }
  static constexpr const char* kSpec = "predictive:90";
  std::unique_ptr<Codec> general = *train_codec(kSpec, SampleFormat::rgba8_depth8, {}, 1);
};

TEST_F(FitTables, SaveBytesOfOtherTilesOfTheField) {
  const auto fitted = fit_tables(
      general->tables(), [&](const Codec& codec, bool) { return encode(codec, tiles(1, 40)); });
  ASSERT_TRUE(fitted) << fitted.error().message;
  const auto codec = make_codec(kSpec, SampleFormat::rgba8_depth8, *fitted);
  ASSERT_TRUE(codec) << codec.error().message;
  std::size_t before = 0, after = 0;
  ASSERT_TRUE(encode(*general, tiles(2, 10), &before));
  ASSERT_TRUE(encode(**codec, tiles(2, 10), &after));
  EXPECT_LT(static_cast<double>(after), 0.95 * static_cast<double>(before));
}

TEST_F(FitTables, DoNotDependOnTheOrderOfTiles) {
  auto sample = tiles(3, 20);
  const auto fit = [&] {
    return *fit_tables(general->tables(),
                       [&](const Codec& codec, bool) { return encode(codec, sample); });
  };
  const Bytes first = fit();
  std::ranges::reverse(sample);
  EXPECT_EQ(fit(), first);
}

TEST_F(FitTables, NothingToFitToLeavesThemUsable) {
  const auto fitted =
      fit_tables(general->tables(), [](const Codec&, bool) { return Result<void>(); });
  ASSERT_TRUE(fitted);
  std::size_t bytes = 0;
  const auto codec = make_codec(kSpec, SampleFormat::rgba8_depth8, *fitted);
  ASSERT_TRUE(codec);
  EXPECT_TRUE(encode(**codec, tiles(4, 2), &bytes));
}

TEST_F(FitTables, ErrorsOfTheSampleComeThrough) {
  const auto fitted = fit_tables(general->tables(), [](const Codec&, bool) -> Result<void> {
    return tl::unexpected(Error{ErrorCode::cancelled, "no"});
  });
  ASSERT_FALSE(fitted);
  EXPECT_EQ(fitted.error().code, ErrorCode::cancelled);
}

}  // namespace
}  // namespace slf::codec
