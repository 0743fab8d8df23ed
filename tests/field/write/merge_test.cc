// Fields built in parts and merged: the same, byte for byte, as fields that one build makes.
#include "slf/merge.h"

#include <gtest/gtest.h>

#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/write/tile_tracer.h"
#include "slf/repack.h"
#include "slf/verify.h"
#include "storage/tile_writer.h"
#include "tests/field/write/rewriting.h"

namespace slf {
namespace {

using storage::TileState;
using testing::all_tiles;
using testing::build_and_open;
using testing::lossless_options;
using testing::read_text;
using testing::stripes;
using testing::TemporaryFolder;

using Paths = std::vector<std::string>;

BuildOptions options_for(const std::string& codec, unsigned levels = 1) {
  auto options = lossless_options(2, 4, levels);
  options.codec = codec;
  return options;
}

class Merge : public ::testing::Test {
 protected:
  /// Builds one part, and returns its path.
  std::string part(BuildOptions options, const ShardOptions& shard, const std::string& name) {
    options.shard = shard;
    const auto field = build_and_open(*scene_, folder_ / name, options);
    EXPECT_TRUE(field);
    if (field) {
      EXPECT_TRUE(field->content()->complete) << name;
      const auto verified = verify_field(field->path(), {});
      EXPECT_TRUE(verified && verified->found == 0) << name;
    }
    return folder_ / name;
  }
  std::string shard(const BuildOptions& options, std::uint32_t k, std::uint32_t n,
                    const std::string& coarser = "") {
    ShardOptions shard;
    shard.index = k, shard.count = n, shard.coarser = coarser;
    return part(options, shard, std::to_string(k) + "-of-" + std::to_string(n) + ".slf");
  }
  Paths shards(const BuildOptions& options, std::uint32_t n, const std::string& coarser = "") {
    Paths paths;
    for (std::uint32_t k = n; k > 0; --k) paths.push_back(shard(options, k, n, coarser));
    return paths;
  }
  std::string levels(const BuildOptions& options, unsigned first, unsigned last,
                     const std::string& name) {
    ShardOptions shard;
    shard.first_level = first, shard.last_level = last;
    return part(options, shard, name);
  }
  /// The field that one build makes, laid out by repack.
  std::string whole(const BuildOptions& options) {
    std::filesystem::remove(folder_ / "whole.slf");
    const auto field = build_and_open(*scene_, folder_ / "whole.slf", options);
    return repacked("whole.slf");
  }
  std::string repacked(const std::string& name) {
    const auto field = Field::open(folder_ / name);
    EXPECT_TRUE(field);
    RepackOptions options;
    options.replace = true;
    EXPECT_TRUE(repack_field(*field, folder_ / ("repacked-" + name), options));
    return read_text(folder_ / ("repacked-" + name));
  }
  void expect_merges_to(const Paths& parts, const std::string& expected) {
    MergeOptions options;
    options.replace = true;
    const auto merged = merge_fields(parts, folder_ / "merged.slf", options);
    ASSERT_TRUE(merged) << merged.error().message;
    const std::string bytes = read_text(folder_ / "merged.slf");
    EXPECT_EQ(merged->file_bytes, bytes.size());
    EXPECT_TRUE(bytes == expected) << "the merged field differs";
    EXPECT_TRUE(repacked("merged.slf") == expected) << "it differs after a repack";
    const auto verified = verify_field(folder_ / "merged.slf", {});
    EXPECT_TRUE(verified && verified->found == 0 && verified->complete);
  }
  void expect_refused(const Paths& parts, ErrorCode code, const Paths& says,
                      const MergeOptions& options = {}) {
    const auto files = folder_.files();
    const auto merged = merge_fields(parts, folder_ / "refused.slf", options);
    ASSERT_FALSE(merged);
    EXPECT_EQ(merged.error().code, code) << merged.error().message;
    for (const std::string& part : says)
      EXPECT_NE(merged.error().message.find(part), std::string::npos) << merged.error().message;
    EXPECT_EQ(folder_.files(), files);
  }

  TemporaryFolder folder_;
  std::unique_ptr<Scene> scene_ = std::make_unique<testing::FunctionScene>(stripes());
};

TEST_F(Merge, AnyNumberOfShardsMakesTheSameField) {
  for (const char* codec : {"zstd:1", "jpeg:60", "predictive:80"}) {
    const BuildOptions options = options_for(codec);
    const std::string expected = whole(options);
    for (const std::uint32_t n : {1u, 2u, 3u, 8u, 64u}) {
      SCOPED_TRACE(codec + (" in " + std::to_string(n)));
      expect_merges_to(shards(options, n), expected);
    }
    for (const std::string& file : folder_.files()) std::filesystem::remove(folder_ / file);
  }
}

TEST_F(Merge, ShardsOfSeveralNumbersGoTogether) {
  const BuildOptions options = options_for("predictive:80");
  const std::string expected = whole(options);
  expect_merges_to({shard(options, 8, 8), shard(options, 1, 2), shard(options, 3, 4),
                    shard(options, 14, 16), shard(options, 13, 16)},
                   expected);
}

TEST_F(Merge, CoarserLevelsAreBuiltOnce) {
  const BuildOptions options = options_for("predictive:80", 2);
  const std::string expected = whole(options);
  const std::string coarse = levels(options, 0, 1, "coarse.slf");
  Paths parts = shards(options, 5, coarse);
  // A shard that has them elsewhere holds nothing but its part.
  std::uint64_t tiles = 0;
  for (const std::string& path : parts) tiles += all_tiles(*Field::open(path)).size();
  EXPECT_EQ(tiles, 64u * 256);
  parts.push_back(coarse);
  expect_merges_to(parts, expected);
}

TEST_F(Merge, LevelsMayBeMergedOneByOne) {
  const BuildOptions options = options_for("predictive:80", 2);
  const std::string expected = whole(options);
  const std::string zero = levels(options, 0, 0, "zero.slf");
  const std::string one = shard(options, 1, 2, zero), two = shard(options, 2, 2, zero);
  expect_refused({zero, one, two}, ErrorCode::usage, {"no part holds tiles 2/0 to 2/16383"});
  MergeOptions partly;
  partly.part = true;
  ASSERT_TRUE(merge_fields({two, zero, one}, folder_ / "coarse.slf", partly));
  const auto coarse = Field::open(folder_ / "coarse.slf");
  EXPECT_EQ(coarse->part(), (TileRange{{0, 0}, {2, 0}}));
  Paths parts = shards(options, 3, coarse->path());
  parts.push_back(coarse->path());
  expect_merges_to(parts, expected);
  expect_refused({parts[0], parts[2], zero}, ErrorCode::usage, {"no part holds tiles 1/0"}, partly);
}

TEST_F(Merge, ShardsHaveEqualWork) {
  auto options = options_for("zstd:1", 2);
  const auto field = build_and_open(*scene_, folder_ / "whole.slf", options);
  const TileTracer tracer(*scene_, field->file().manifest());
  const TileOrder order(field->shape());
  std::vector<std::uint64_t> rays;
  for (const std::string& path : shards(options, 7)) {
    std::uint64_t& sum = rays.emplace_back(0);
    const TileRange part = *Field::open(path)->part();
    for (std::uint64_t n = order.number(part.begin); n < order.number(part.end); ++n)
      sum += tracer.rays(order.key(n));
  }
  const auto [min, max] = std::ranges::minmax(rays);
  EXPECT_LT(max - min, 2 * tracer.rays(TileKey{0, 0}) + tracer.rays(TileKey{0, 9}));
}

TEST_F(Merge, SubfieldsAndLevelsThatRepackKeptGoTogether) {
  for (const char* codec : {"zstd:1", "jpeg:60"}) {
    const BuildOptions options = options_for(codec);
    const std::string expected = whole(options);
    const auto field = Field::open(folder_ / "whole.slf");
    Paths parts;
    for (const std::uint8_t first : {40, 0, 7}) {
      RepackOptions repack;
      const int end = first == 40 ? 64 : first == 0 ? 7 : 40;
      for (int k = first; k < end; ++k) repack.subfields.push_back(static_cast<std::uint8_t>(k));
      parts.push_back(folder_ / ("from-" + std::to_string(first) + ".slf"));
      repack.replace = true;
      ASSERT_TRUE(repack_field(*field, parts.back(), repack));
    }
    expect_merges_to(parts, expected);
    expect_refused({parts[0], parts[1], parts[0]}, ErrorCode::usage, {"is given twice"});
    MergeOptions some;
    some.replace = true;
    ASSERT_TRUE(merge_fields({parts[1], parts[0]}, folder_ / "some.slf", some));
    EXPECT_EQ(Field::open(folder_ / "some.slf")->shape().subfields.size(), 31u);
  }
}

TEST_F(Merge, SubfieldsEncodedAnewAreMergedAsTheyAre) {
  const BuildOptions options = options_for("predictive:80");
  (void)whole(options);
  const auto field = Field::open(folder_ / "whole.slf");
  Paths parts;
  for (const int first : {0, 24}) {
    RepackOptions repack;
    for (int k = first; k < (first == 0 ? 24 : 64); ++k)
      repack.subfields.push_back(static_cast<std::uint8_t>(k));
    parts.push_back(folder_ / ("from-" + std::to_string(first) + ".slf"));
    ASSERT_TRUE(repack_field(*field, parts.back(), repack));
  }
  ASSERT_TRUE(merge_fields(parts, folder_ / "merged.slf", {}));
  const auto verified = verify_field(folder_ / "merged.slf", {});
  EXPECT_TRUE(verified && verified->found == 0 && verified->complete);

  // Each tile has the samples that it has in its part: it refers to no other part.
  const auto merged = FieldFile::open(folder_ / "merged.slf");
  ASSERT_TRUE(merged);
  std::uint64_t compared = 0;
  for (const std::string& path : parts) {
    const auto part = FieldFile::open(path);
    ASSERT_TRUE(part);
    const auto visited =
        (*part)->store().visit({}, {255, 0}, [&](const storage::TileRef& tile) -> Result<void> {
          if (tile.state != TileState::stored) return {};
          const auto there = (*merged)->store().find(tile.key);
          if (!there) return tl::unexpected(there.error());
          EXPECT_EQ(there->state, TileState::stored);
          Bytes of_part((*part)->tile_shape(tile.key).bytes()), of_merged(of_part.size());
          if (auto ok = testing::read(**part, tile, of_part); !ok) return ok;
          if (auto ok = testing::read(**merged, *there, of_merged); !ok) return ok;
          EXPECT_TRUE(of_part == of_merged) << int{tile.key.level} << "/" << tile.key.index;
          ++compared;
          return {};
        });
    EXPECT_TRUE(visited);
  }
  EXPECT_GT(compared, 100u);

  expect_refused({levels(options, 0, 0, "zero.slf"), parts[0], parts[1]}, ErrorCode::usage,
                 {"from-0.slf", "encoded anew"});
}

TEST_F(Merge, LevelsThatRepackKeptServeAsThoseOfABuild) {
  const BuildOptions options = options_for("predictive:80");
  const std::string expected = whole(options);
  RepackOptions coarse;
  coarse.finest_level = 0;
  ASSERT_TRUE(repack_field(*Field::open(folder_ / "whole.slf"), folder_ / "coarse.slf", coarse));
  expect_merges_to({levels(options, 1, 1, "fine.slf"), folder_ / "coarse.slf"}, expected);
}

TEST_F(Merge, NamesWhatIsMissingDoubleOrForeign) {
  const BuildOptions options = options_for("jpeg:60");
  const Paths parts = shards(options, 4);  // 4/4 first
  expect_refused({}, ErrorCode::usage, {"no parts"});
  expect_refused({parts[0], parts[2], parts[3]}, ErrorCode::usage, {"no part holds tiles 1/"});
  expect_refused({parts[0], parts[1], parts[3], parts[2], parts[1]}, ErrorCode::usage,
                 {"3-of-4.slf: is given twice"});
  expect_refused({parts[0], parts[1], parts[3], parts[2], shard(options, 5, 8)}, ErrorCode::usage,
                 {"3-of-4.slf", "5-of-8.slf", "both hold tiles 1/"});
  auto other = options;
  other.codec = "jpeg:61";
  expect_refused({parts[0], parts[1], parts[2], shard(other, 1, 5)}, ErrorCode::usage,
                 {"1-of-5.slf", "4-of-4.slf", "/codec differs"});
  other = options;
  other.shape.exit_side = 5;
  expect_refused({parts[0], shard(other, 1, 6)}, ErrorCode::usage, {"/exit_side differs"});
  expect_refused({parts[0], folder_ / "none.slf"}, ErrorCode::not_found, {"none.slf"});
  testing::write_text(folder_ / "text.slf", std::string(20000, 'x'));
  expect_refused({parts[0], folder_ / "text.slf"}, ErrorCode::bad_file, {"text.slf"});
  MergeOptions force;
  force.replace = true;
  const auto onto_itself = merge_fields(parts, parts[1], force);
  ASSERT_FALSE(onto_itself);
  EXPECT_NE(onto_itself.error().message.find("is the input"), std::string::npos);
}

TEST_F(Merge, OtherTablesAreOtherFields) {
  const BuildOptions options = options_for("jpeg:60");
  const Paths parts = shards(options, 2);
  auto dark = std::make_unique<testing::FunctionScene>(stripes(0.3F));
  scene_ = std::move(dark);
  expect_refused({parts[0], shard(options, 1, 3)}, ErrorCode::usage, {"the codec's tables differ"});
}

TEST_F(Merge, AnUnfinishedPartIsNamed) {
  const BuildOptions options = options_for("zstd:1");
  const Paths parts = shards(options, 2);
  BuildOptions stopped = options;
  stopped.shard.index = 2, stopped.shard.count = 3;
  stopped.commit_seconds = 0;
  EXPECT_FALSE(build_field(*scene_, folder_ / "stopped.slf", stopped,
                           [](const Progress& p) { return 3 * p.done < p.total; }));
  expect_refused({parts[0], folder_ / "stopped.slf"}, ErrorCode::failed,
                 {"stopped.slf: is not finished", "stopped.slf.unfinished"});
  expect_refused({parts[0], folder_ / "stopped.slf.unfinished"}, ErrorCode::failed,
                 {"stopped.slf.unfinished", "were not built"});
  {
    auto writer = storage::TileWriter::resume(parts[1]);
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->drop({0, 5}));
    ASSERT_TRUE(writer->close());
  }
  expect_refused(parts, ErrorCode::failed, {"1-of-2.slf", "dropped"});
  // The same build fills it.
  expect_merges_to({shard(options, 1, 2), parts[0]}, whole(options));
}

TEST_F(Merge, ADamagedTileIsNamed) {
  const Paths parts = shards(options_for("zstd:1"), 2);
  const auto field = Field::open(parts[1]);
  TileKey key{1, 0};
  while (field->file().store().find(key)->state != TileState::stored) ++key.index;
  std::string bytes = read_text(parts[1]);
  bytes[field->file().store().range(*field->file().store().find(key)).begin] ^= 1;
  testing::write_text(parts[1], bytes);
  expect_refused(parts, ErrorCode::bad_file, {"1-of-2.slf", "tile 1/" + std::to_string(key.index)});
}

TEST_F(Merge, AnEmptyShardIsAPartToo) {
  auto options = options_for("zstd:1", 0);
  const std::string expected = whole(options);
  expect_merges_to(shards(options, 70), expected);
}

TEST_F(Merge, StopsWhenAsked) {
  const Paths parts = shards(options_for("zstd:1"), 2);
  const auto stopped = merge_fields(parts, folder_ / "stopped.slf", {},
                                    [](const Progress& p) { return 2 * p.done < p.total; });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::cancelled);
  EXPECT_EQ(folder_.files(), (Paths{"1-of-2.slf", "2-of-2.slf"}));
}

TEST_F(Merge, BytesDoNotDependOnThreads) {
  const Paths parts = shards(options_for("zstd:1"), 3);
  MergeOptions one;
  one.threads = 1;
  ASSERT_TRUE(merge_fields(parts, folder_ / "one.slf", one));
  ASSERT_TRUE(merge_fields({parts[2], parts[0], parts[1]}, folder_ / "all.slf", {}));
  EXPECT_TRUE(read_text(folder_ / "one.slf") == read_text(folder_ / "all.slf"));
}

// ---- building parts
// ------------------------------------------------------------------------------

TEST_F(Merge, APartIsResumed) {
  BuildOptions options = options_for("predictive:80");
  const std::string expected = shard(options, 2, 3);
  BuildOptions stopped = options;
  stopped.shard.index = 2, stopped.shard.count = 3;
  stopped.commit_seconds = 0;
  const std::string path = folder_ / "stopped.slf";
  for (const std::uint64_t share : {10, 5, 3, 2})
    EXPECT_FALSE(build_field(*scene_, path, stopped,
                             [&](const Progress& p) { return share * p.done < p.total; }));
  const auto report = build_field(*scene_, path, stopped);
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_GT(report->resumed, 0u);
  EXPECT_EQ(all_tiles(*Field::open(path)), all_tiles(*Field::open(expected)));
  EXPECT_EQ(build_field(*scene_, path, stopped)->tiles, 0u);
}

TEST_F(Merge, AnotherPartIsInTheWay) {
  BuildOptions options = options_for("zstd:1");
  const std::string path = shard(options, 1, 2);
  options.shard.index = 2, options.shard.count = 2;
  const auto refused = build_field(*scene_, path, options);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::usage);
  EXPECT_NE(refused.error().message.find("another part"), std::string::npos);
}

TEST_F(Merge, RefusesShardsThatMakeNoSense) {
  const BuildOptions options = options_for("predictive:80");
  const std::string coarse = levels(options, 0, 0, "coarse.slf");
  const std::string fine = levels(options, 1, 1, "fine.slf");
  const auto refused = [&](const ShardOptions& shard, const std::string& says,
                           const std::string& codec = "predictive:80") {
    BuildOptions wrong = options_for(codec);
    wrong.shard = shard;
    const auto report = build_field(*scene_, folder_ / "wrong.slf", wrong);
    ASSERT_FALSE(report) << says;
    EXPECT_EQ(report.error().code, ErrorCode::usage) << says;
    EXPECT_NE(report.error().message.find(says), std::string::npos) << report.error().message;
  };
  const auto shard = [](std::uint32_t k, std::uint32_t n, std::optional<unsigned> first = {},
                        std::optional<unsigned> last = {}, const std::string& from = "") {
    ShardOptions wanted;
    wanted.index = k, wanted.count = n, wanted.first_level = first, wanted.last_level = last;
    wanted.coarser = from;
    return wanted;
  };
  refused(shard(0, 2), "shard 0/2");
  refused(shard(3, 2), "shard 3/2");
  refused(shard(1, 1, 2, 2), "levels 2 to 2");
  refused(shard(1, 1, 1, 0), "levels 1 to 0");
  refused(shard(1, 1, 0, 1, coarse), "can only be used to build level 1");
  refused(shard(1, 2, {}, {}, fine), "levels from 0 on");
  refused(shard(1, 2, {}, {}, coarse), "/codec differs", "predictive:70");
  refused(shard(1, 2, {}, {}, coarse), "not needed", "zstd:1");
}

}  // namespace
}  // namespace slf
