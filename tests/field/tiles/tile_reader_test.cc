// TileReader: one place for decoded tiles, whoever reads them.
#include "slf/tile_reader.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>

#include "field/tiles/tile_cache.h"
#include "slf/inspect.h"
#include "slf/player.h"
#include "slf/render.h"
#include "slf/scene.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using testing::TemporaryFolder;

class TileReaderTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    auto options = testing::lossless_options(8, 16, 1);
    options.codec = "predictive:80";
    options.depth = true;
    const auto scene = std::move(*make_analytic_scene("balls"));
    field_ = new Field(*testing::build_and_open(*scene, *folder_ / "balls.slf", options));
  }
  static void TearDownTestSuite() {
    delete field_;
    delete folder_;
  }

  static Camera camera() { return orbit_camera(field_->shape().sphere, 30, 20, 3, 96, 96); }
  static ViewStatistics draw(Renderer& renderer) {
    ViewStatistics statistics;
    EXPECT_TRUE(renderer.render(camera(), {RenderMode::depth, 1}, &statistics));
    return statistics;
  }
  static TileKey some_stored_tile(std::uint8_t level) {
    TileKey key{level, 0};
    while (field_->file().store().find(key)->state != storage::TileState::stored) ++key.index;
    return key;
  }

  static inline TemporaryFolder* folder_ = nullptr;
  static inline Field* field_ = nullptr;
};

TEST_F(TileReaderTest, ReadersOfOneFieldKeepTheirOwnBudgets) {
  constexpr std::uint64_t kSmall = 512 << 10;
  const TileReader roomy(*field_, {.memory = 64 << 20}), tight(*field_, {.memory = kSmall});
  Renderer first(roomy, 1), second(tight, 1);
  const ViewStatistics all = draw(first), few = draw(second);
  EXPECT_GT(all.decoded_peak_bytes, kSmall);
  EXPECT_LE(few.decoded_peak_bytes, kSmall);
  EXPECT_LT(all.decodes, few.decodes);  // each tile once, and again when it was evicted
  EXPECT_EQ(draw(first).decodes, 0u);   // all are still there
}

TEST_F(TileReaderTest, RenderersOfOneReaderShareItsTiles) {
  const TileReader tiles(*field_, {.memory = 64 << 20});
  Renderer first(tiles, 1), second(tiles, 2);
  EXPECT_GT(draw(first).decodes, 0u);
  EXPECT_EQ(draw(second).decodes, 0u);
}

TEST_F(TileReaderTest, PlayersShareTheTilesOfARenderer) {
  const TileReader tiles(*field_, {.memory = 64 << 20});
  Renderer renderer(tiles, 1);
  const ViewOptions view{RenderMode::depth, 1};
  const Image still = *renderer.render(camera(), view);
  for (const Loading loading : {Loading::demand, Loading::wait}) {
    auto player =
        Player::make(tiles, {.renderer = {.threads = 1}, .view = view, .loading = loading});
    ASSERT_TRUE(player) << player.error().message;
    EXPECT_EQ(&player->tiles().cache(), &tiles.cache());
    Image frame;
    FrameReport report;
    ASSERT_TRUE(player->draw(camera(), frame, &report));
    EXPECT_EQ(report.misses, 0u);
    EXPECT_EQ(report.loads, 0u);
    EXPECT_EQ(frame.rgba, still.rgba);
  }
}

TEST_F(TileReaderTest, RenderersShareTheTilesOfAPlayer) {
  auto player = Player::make(
      *field_,
      {.renderer = {.threads = 1}, .view = {RenderMode::depth, 1}, .loading = Loading::wait});
  ASSERT_TRUE(player);
  Image frame;
  ASSERT_TRUE(player->draw(camera(), frame));
  Renderer renderer(player->tiles(), 1);
  EXPECT_EQ(draw(renderer).decodes, 0u);
}

TEST_F(TileReaderTest, APlayerPinsLevel0AlsoInAReaderThatIsFull) {
  const TileReader tiles(*field_, {.memory = 1 << 20});
  const auto read_level_1 = [&] {
    for (std::uint64_t index = 0; index < tile_count(1, 0); ++index)
      ASSERT_TRUE(tiles.read({1, index}));
  };
  read_level_1();
  const auto player =
      Player::make(tiles, {.renderer = {.threads = 1}, .view = {RenderMode::depth, 1}});
  ASSERT_TRUE(player);
  read_level_1();
  const std::uint64_t decodes = tiles.cache().statistics().decodes;
  ASSERT_TRUE(tiles.read(some_stored_tile(0)));
  EXPECT_EQ(tiles.cache().statistics().decodes, decodes);
}

TEST_F(TileReaderTest, TilesThatOthersArePredictedFromAreTilesLikeAnyOther) {
  const TileReader tiles(*field_, {.memory = 64 << 20});
  const TileKey fine = some_stored_tile(1);
  const auto references = *field_->file().references(*field_->file().store().find(fine));
  ASSERT_FALSE(references.empty());
  ASSERT_TRUE(tiles.read(fine));
  const std::uint64_t decodes = tiles.cache().statistics().decodes;
  EXPECT_EQ(decodes, 1 + references.size());
  ASSERT_TRUE(tiles.read(references.front()));
  EXPECT_EQ(tiles.cache().statistics().decodes, decodes);
}

TEST_F(TileReaderTest, ATileOutlivesItsReader) {
  const TileKey key = some_stored_tile(1);
  const TileShape shape = field_->file().tile_shape(key);
  std::optional<TileReader::Tile> tile;
  std::vector<std::byte> before;
  {
    const TileReader tiles(*field_, {.memory = 1});
    tile = *tiles.read(key);
    before.assign(tile->colors().begin(), tile->colors().end());
    ASSERT_TRUE(tiles.read(some_stored_tile(0)));  // over the budget
  }
  EXPECT_EQ(tile->colors().size(), shape.color_bytes());
  EXPECT_EQ(tile->depths().size(), shape.samples());
  EXPECT_TRUE(std::ranges::equal(tile->colors(), before));
  EXPECT_FALSE(tile->missing());
}

/// How many files with that path this process has mapped.
std::size_t maps_of(const std::string& path) {
  std::ifstream maps("/proc/self/maps");
  std::size_t count = 0;
  for (std::string line; std::getline(maps, line);) count += line.ends_with(path);
  return count;
}

TEST(TileReaderErrors, AFailedReadKeepsNothing) {
  const TemporaryFolder folder;
  const std::string path = std::filesystem::canonical(folder.path()) / "flipped_tile.slf";
  std::filesystem::copy_file(SLF_TEST_DATA "/golden/flipped_tile.slf", path);
  int failed = 0;
  {
    const TileReader tiles(*Field::open(path));
    EXPECT_EQ(maps_of(path), 1u);
    const FieldShape& shape = tiles.field().shape();
    for (unsigned level = 0; level <= shape.finest_level; ++level)
      for (std::uint64_t index = 0; index < shape.tiles(level); ++index) {
        const TileKey key{static_cast<std::uint8_t>(level), index};
        failed += !tiles.read(key);
        failed += !read_tile(tiles, key, "color");
      }
  }
  EXPECT_GE(failed, 2);
  EXPECT_EQ(maps_of(path), 0u);
}

TEST_F(TileReaderTest, RefusesTilesThatTheFieldDoesNotHave) {
  const TileReader tiles(*field_);
  EXPECT_EQ(tiles.read({2, 0}).error().code, ErrorCode::usage);
  EXPECT_EQ(tiles.read({0, 64}).error().code, ErrorCode::usage);
}

}  // namespace
}  // namespace slf
