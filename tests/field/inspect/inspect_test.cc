// Lists of tiles, single tiles, and differences between fields.
#include "slf/inspect.h"

#include <gtest/gtest.h>

#include "field/field_file.h"
#include "slf/repack.h"
#include "storage/tile_writer.h"
#include "tests/field/write/rewriting.h"

namespace slf {
namespace {

using testing::all_tiles;
using testing::build_and_open;
using testing::lossless_options;
using testing::stripes;
using testing::TemporaryFolder;

class Inspect : public ::testing::Test {
 protected:
  void SetUp() override {
    field_ = build_and_open(stripes(), folder_ / "in.slf", lossless_options(2, 5, 1));
    ASSERT_TRUE(field_);
  }

  std::optional<Field> repack(const std::string& name, const RepackOptions& options) {
    const auto done = repack_field(*field_, folder_ / name, options);
    EXPECT_TRUE(done) << (done ? "" : done.error().message);
    auto field = Field::open(folder_ / name);
    EXPECT_TRUE(field);
    return field ? std::optional(*field) : std::nullopt;
  }

  /// A copy with some tiles changed.
  template <class Change>
  std::optional<Field> changed(const std::string& name, const Change& change) {
    std::filesystem::copy_file(field_->path(), folder_ / name);
    auto writer = storage::TileWriter::resume(folder_ / name);
    EXPECT_TRUE(writer);
    change(*writer);
    EXPECT_TRUE(writer->close());
    auto field = Field::open(folder_ / name);
    EXPECT_TRUE(field);
    return field ? std::optional(*field) : std::nullopt;
  }

  static std::vector<ListedTile> list(const Field& field, const TileFilter& filter = {}) {
    std::vector<ListedTile> tiles;
    const auto ok = list_tiles(field, filter, [&](const ListedTile& tile) -> Result<void> {
      tiles.push_back(tile);
      return {};
    });
    EXPECT_TRUE(ok) << (ok ? "" : ok.error().message);
    return tiles;
  }

  TileKey some_stored_tile() {
    for (const ListedTile& tile : list(*field_, {.first_level = 1}))
      if (tile.state == TileState::stored) return tile.key;
    ADD_FAILURE();
    return {};
  }

  TemporaryFolder folder_;
  std::optional<Field> field_;
};

TEST_F(Inspect, ListsEveryTileWithItsPayload) {
  const auto expected = all_tiles(*field_);
  const auto listed = list(*field_);
  ASSERT_EQ(listed.size(), expected.size());
  const std::string file = testing::read_text(field_->path());
  auto at = expected.begin();
  for (const ListedTile& tile : listed) {
    const auto& [place, payload] = *at++;
    EXPECT_EQ(place, tile.key);
    EXPECT_EQ(tile.state == TileState::stored, !payload.empty());
    EXPECT_EQ(file.substr(tile.offset_bytes, tile.payload_bytes), payload);
    EXPECT_EQ(find_tile(*field_, tile.address), tile.key);
    EXPECT_EQ(find_tile(*field_, tile.key.level, tile.key.index), tile.key);
  }
}

TEST_F(Inspect, FiltersByLevelAndSubfield) {
  EXPECT_EQ(list(*field_, {.last_level = 0}).size(), 64u);
  EXPECT_EQ(list(*field_, {.first_level = 1}).size(), 1024u);
  const auto some = list(*field_, {.first_level = 1, .subfields = {3, 62}});
  ASSERT_EQ(some.size(), 32u);
  for (const ListedTile& tile : some)
    EXPECT_EQ(tile.subfield, tile.key.index < 64 ? 3 : 62) << tile.key.index;
  RepackOptions options;
  options.subfields = {3, 9};
  const auto part = repack("part.slf", options);
  EXPECT_EQ(list(*part).size(), 2 * 17u);
  for (const TileFilter& wrong : {TileFilter{.first_level = 2}, TileFilter{.subfields = {4}}}) {
    const auto refused = list_tiles(*part, wrong, [](const ListedTile&) { return Result<void>(); });
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::usage);
  }
}

TEST_F(Inspect, ListsMissingTilesWhereAsked) {
  const auto holed = changed("holed.slf", [](storage::TileWriter& writer) {
    for (const std::uint64_t index : {0u, 500u, 1023u}) ASSERT_TRUE(writer.drop({1, index}));
  });
  EXPECT_EQ(list(*holed).size(), 1088u - 3);
  std::vector<std::uint64_t> missing;
  for (const ListedTile& tile : list(*holed, {.missing = true}))
    if (tile.state == TileState::missing) {
      EXPECT_EQ(tile.key.level, 1);
      missing.push_back(tile.key.index);
    }
  EXPECT_EQ(missing, (std::vector<std::uint64_t>{0, 500, 1023}));
}

TEST_F(Inspect, AVisitorEndsTheList) {
  int visited = 0;
  const auto ended = list_tiles(*field_, {}, [&](const ListedTile&) -> Result<void> {
    if (++visited < 7) return {};
    return fail(ErrorCode::io, "enough");
  });
  ASSERT_FALSE(ended);
  EXPECT_EQ(ended.error().message, "enough");
  EXPECT_EQ(visited, 7);
}

TEST_F(Inspect, RefusesTilesThatTheFieldHasNot) {
  EXPECT_FALSE(find_tile(*field_, {2, 0, 0}));
  EXPECT_FALSE(find_tile(*field_, {1, 32, 0}));
  EXPECT_FALSE(find_tile(*field_, {1, 0, 32}));
  EXPECT_FALSE(find_tile(*field_, 1, 1024));
  EXPECT_TRUE(find_tile(*field_, {1, 31, 31}));
}

TEST_F(Inspect, ChannelsAreTheSamplesThatTheFieldDecodes) {
  const TileKey key = some_stored_tile();
  const Bytes both = testing::all_samples(*field_).at(key);
  const TileReader tiles(*field_);
  const auto color = read_tile(tiles, key, "color"), depth = read_tile(tiles, key, "depth");
  ASSERT_TRUE(color && depth);
  for (const auto& [set, numbers] : {std::pair(&*color, 4u), std::pair(&*depth, 1u)}) {
    EXPECT_EQ(set->numbers, numbers);
    EXPECT_FALSE(set->half);
    EXPECT_EQ(set->samples.size(), set->entries.size() * 21 * numbers);
  }
  Bytes joined(color->samples.begin(), color->samples.end());
  joined.insert(joined.end(), depth->samples.begin(), depth->samples.end());
  EXPECT_EQ(joined, both);
  EXPECT_EQ(read_tile(tiles, key, "normal").error().code, ErrorCode::usage);
}

TEST_F(Inspect, APictureShowsEverySampleOnce) {
  const TileKey key = some_stored_tile();
  const TileReader tiles(*field_);
  const auto set = read_tile(tiles, key, "color");
  const auto picture = tile_picture(tiles, key, "color");
  ASSERT_TRUE(set && picture);
  glm::dvec4 expected(0), found(0);
  for (std::size_t k = 0; k < set->samples.size(); ++k)
    expected[static_cast<int>(k % 4)] += std::to_integer<int>(set->samples[k]) / 255.;
  for (const glm::vec4& pixel : picture->rgba) found += glm::dvec4(pixel);
  for (int c = 0; c < 4; ++c) EXPECT_NEAR(found[c], expected[c], 1e-3) << c;
  const auto depth = tile_picture(tiles, key, "depth");
  double opaque = 0;
  for (const glm::vec4& pixel : depth->rgba) opaque += pixel.a;
  EXPECT_EQ(opaque, static_cast<double>(set->entries.size() * 21));
}

TEST_F(Inspect, AFieldDoesNotDifferFromItsCopy) {
  const auto copy = changed("copy.slf", [](storage::TileWriter&) {});
  const auto difference = diff_fields(*field_, *copy);
  ASSERT_TRUE(difference);
  EXPECT_TRUE(difference->equal());
  ASSERT_EQ(difference->channels.size(), 2u);
  EXPECT_EQ(difference->channels[0].compared, 1088u);
  EXPECT_FALSE(std::isfinite(difference->channels[0].psnr));
}

TEST_F(Inspect, FindsTheTileThatWasChanged) {
  const TileKey key = some_stored_tile();
  Bytes samples = testing::all_samples(*field_).at(key);
  samples[0] ^= std::byte{64};
  Bytes payload;
  const TileShape shape = field_->file().tile_shape(key);
  ASSERT_TRUE(field_->file().codec().encode(shape, samples, nullptr, payload));
  const auto other = changed("other.slf", [&](storage::TileWriter& writer) {
    ASSERT_TRUE(writer.replace(key, payload));
    ASSERT_TRUE(writer.drop({1, 9}));
  });
  const auto difference = diff_fields(*field_, *other, {.threads = 2});
  ASSERT_TRUE(difference);
  EXPECT_FALSE(difference->equal());
  EXPECT_TRUE(difference->manifest.empty());
  const ChannelDifference &color = difference->channels[0], &depth = difference->channels[1];
  EXPECT_EQ(color.differing, 1u);
  EXPECT_EQ(color.worst, key);
  const double expected =
      -10 * std::log10(64. * 64 / (255. * 255) / static_cast<double>(shape.color_bytes()));
  EXPECT_NEAR(color.worst_psnr, expected, 0.01);
  EXPECT_GT(color.psnr, color.worst_psnr);
  EXPECT_EQ(depth.recoded, 1u);
  EXPECT_EQ(depth.only_in_a, 1u);
  EXPECT_EQ(depth.compared, 1087u);
  EXPECT_FALSE(difference->alike(0));
}

TEST_F(Inspect, OtherBytesOfTheSameSamplesAreToldApart) {
  RepackOptions options;
  options.codec = "raw";
  const auto raw = repack("raw.slf", options);
  const auto difference = diff_fields(*field_, *raw);
  ASSERT_TRUE(difference);
  EXPECT_EQ(difference->manifest, std::vector<std::string>{"/codec"});
  EXPECT_EQ(difference->channels[0].differing, 0u);
  EXPECT_GT(difference->channels[0].recoded, 700u);
  EXPECT_FALSE(difference->equal());
  EXPECT_TRUE(difference->alike(100));
}

TEST_F(Inspect, ComparesOtherFormats) {
  RepackOptions options;
  options.codec = "predictive:90";
  const auto together = repack("together.slf", options);
  options = {};
  options.half = true;
  const auto half = repack("half.slf", options);
  const auto lossy = diff_fields(*field_, *together);
  const auto wide = diff_fields(*field_, *half);
  ASSERT_TRUE(lossy && wide);
  EXPECT_GT(lossy->channels[0].psnr, 28);
  EXPECT_GT(lossy->channels[1].psnr, 28);
  EXPECT_GT(wide->channels[0].worst_psnr, 60);  // half floats round
}

TEST_F(Inspect, WhatIsNoNumberDiffersFromAnyNumber) {
  const auto build = [&](const std::string& name, float red) {
    auto options = testing::lossless_options(2, 4, 0);
    options.half = true, options.codec = "raw";
    const testing::FunctionScene scene([red](const glm::dvec3& from, const glm::dvec3&) {
      return RaySample{{from.x > 0.9 ? red : 0.5f, 0.5f, 0.5f, 1}, 0.5f};
    });
    return *testing::build_and_open(scene, folder_ / name, options);
  };
  const Field number = build("number.slf", 0.5f), none = build("none.slf", std::nanf(""));
  for (const auto& [a, b] : {std::pair{&number, &none}, std::pair{&none, &number}}) {
    const auto difference = diff_fields(*a, *b);
    ASSERT_TRUE(difference);
    EXPECT_GT(difference->channels[0].differing, 0u);
    EXPECT_EQ(difference->channels[0].psnr, -std::numeric_limits<double>::infinity());
    EXPECT_FALSE(difference->alike(0));
    EXPECT_TRUE(difference->channels[0].worst);
  }
  EXPECT_TRUE(diff_fields(none, none)->alike(1000));
}

TEST_F(Inspect, OtherRaysAreNotCompared) {
  const auto finer = build_and_open(stripes(), folder_ / "finer.slf", lossless_options(4, 5, 0));
  const auto difference = diff_fields(*field_, *finer);
  ASSERT_TRUE(difference);
  EXPECT_FALSE(difference->comparable);
  EXPECT_FALSE(difference->equal());
  EXPECT_TRUE(difference->channels.empty());
}

}  // namespace
}  // namespace slf
