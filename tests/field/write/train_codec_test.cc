#include "field/write/train_codec.h"

#include <gtest/gtest.h>

#include "codec/predictive_tables.h"
#include "field/write/tile_tracer.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

class TrainCodec : public ::testing::Test {
 protected:
  TrainCodec() {
    manifest.shape.sphere = scene->bounds();
    manifest.shape.entry_side = 4, manifest.shape.exit_side = 12, manifest.shape.finest_level = 2;
    manifest.format = SampleFormat::rgba8_depth8;
    manifest.codec = "predictive:85";
  }
  [[nodiscard]] Result<std::unique_ptr<codec::Codec>> train(
      unsigned threads, const GoOn& go_on = [] { return true; }) const {
    std::vector<LevelGeometry> levels;
    for (unsigned level = 0; level <= manifest.shape.finest_level; ++level)
      levels.emplace_back(manifest.shape, level);
    return train_codec(
        TileTracer(*scene, manifest),
        [&](unsigned level) -> const LevelGeometry& { return levels[level]; }, manifest, threads,
        go_on);
  }
  [[nodiscard]] codec::ColorMatrix matrix() const {
    const auto trained = train(2);
    EXPECT_TRUE(trained);
    return codec::parse_predictive_tables((*trained)->tables())->levels[0].matrix;
  }
  std::unique_ptr<Scene> scene = *make_analytic_scene("balls");
  Manifest manifest;
};

TEST_F(TrainCodec, DoesNotDependOnThreads) {
  const auto one = train(1), three = train(3);
  ASSERT_TRUE(one && three);
  const ByteSpan first = (*one)->tables(), second = (*three)->tables();
  EXPECT_TRUE(std::ranges::equal(first, second));
}

TEST_F(TrainCodec, FitsLargeFieldsOnly) {
  EXPECT_NE(matrix(), codec::kYcbcr);
  manifest.shape.finest_level = 1;
  EXPECT_EQ(matrix(), codec::kYcbcr);
}

TEST_F(TrainCodec, FitsFieldsOfSomeSubfields) {
  manifest.shape.finest_level = 3;
  manifest.shape.subfields = {3, 28};
  EXPECT_NE(matrix(), codec::kYcbcr);
}

TEST_F(TrainCodec, StopsWhenAsked) {
  int asked = 0;
  const auto stopped = train(2, [&] { return ++asked < 3; });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::cancelled);
  EXPECT_EQ(asked, 3);
}

}  // namespace
}  // namespace slf
