// What a writer promises: commits, resuming, replacing, exclusion, and what it refuses.
#include <gmock/gmock.h>

#include <iterator>

#include "tests/storage/failing_calls.h"
#include "tests/storage/storage_testing.h"

namespace slf::storage::testing {
namespace {

using ::testing::HasSubstr;

TEST(TileWriter, RefusesWhatItShould) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  TileWriter writer = create(path);
  ASSERT_TRUE(ok(writer.append({1, 5}, {})));
  for (const TileKey key : {TileKey{1, 5}, TileKey{1, 4}, TileKey{0, 9}, TileKey{255, 0}})
    EXPECT_EQ(writer.append(key, {}).error().code, ErrorCode::usage);
  EXPECT_EQ(writer.set_blob("", {}).error().code, ErrorCode::usage);
  EXPECT_EQ(writer.set_blob("container", {}).error().code, ErrorCode::usage);
  EXPECT_EQ(writer.set_blob(std::string(256, 'x'), {}).error().code, ErrorCode::usage);
  EXPECT_TRUE(ok(writer.set_blob(std::string(255, 'x'), {})));
  ASSERT_TRUE(ok(writer.close()));
  EXPECT_EQ(writer.commit().error().code, ErrorCode::usage);
  EXPECT_TRUE(ok(TileStore::open(path)->blob(std::string(255, 'x'))));

  EXPECT_EQ(TileWriter::create(path, {}).error().code, ErrorCode::usage);
  EXPECT_EQ(TileWriter::create(folder / "no/b", {}).error().code, ErrorCode::not_found);
  EXPECT_EQ(TileWriter::resume(folder / "c").error().code, ErrorCode::not_found);
}

// The files of LMDB 1.x and 0.9 exclude each other.
TEST(TileWriter, RefusesAnLmdbWithOtherFiles) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf", later = folder / "b.slf";
  ASSERT_TRUE(ok(create(path).close()));
  const auto bytes = read_file(path);
  pretend_lmdb(1);
  const auto created = TileWriter::create(later, {}), resumed = TileWriter::resume(path);
  pretend_lmdb(0);
  for (const auto* refused : {&created, &resumed}) {
    ASSERT_FALSE(*refused);
    EXPECT_EQ(refused->error().code, ErrorCode::unsupported);
    EXPECT_THAT(refused->error().message, HasSubstr("cannot be written with LMDB 1.0"));
  }
  EXPECT_FALSE(std::filesystem::exists(later));
  EXPECT_EQ(read_file(path), bytes);
}

TEST(TileWriter, IsSeenByOthers) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  EXPECT_TRUE(ok(check_no_writer(path)));
  {
    TileWriter writer = create(path);
    EXPECT_EQ(check_no_writer(path).error().code, ErrorCode::busy);
  }
  EXPECT_TRUE(ok(check_no_writer(path)));
  EXPECT_EQ(check_no_writer(folder.path()).error().code, ErrorCode::io);  // cannot tell
}

// LMDB's lock file is in memory, reached through a folder that vanishes; a new container has no
// name. Other systems have no folder for temporary files, or no files without names.
TEST(TileWriter, LeavesNothingBesideTheContainer) {
  const char* const before = std::getenv("TMPDIR");
  const std::string kept = before != nullptr ? before : "";
  for (const bool temporary : {true, false})
    for (const bool unnamed : {true, false}) {
      SCOPED_TRACE(std::to_string(temporary) + std::to_string(unnamed));
      const TemporaryFolder folder, other;
      ASSERT_EQ(setenv("TMPDIR", (temporary ? other.path() : folder / "none").c_str(), 1), 0);
      refuse_unnamed_files(!unnamed);
      const std::string path = folder / "a.slf";
      for (int k = 0; k < 2; ++k) {
        auto writer = k == 0 ? TileWriter::create(path, {}) : TileWriter::resume(path);
        ASSERT_TRUE(ok(writer));
        EXPECT_EQ(folder.files(), std::vector<std::string>{"a.slf"});
        EXPECT_EQ(other.files(), std::vector<std::string>());
        EXPECT_EQ(TileWriter::resume(path).error().code, ErrorCode::busy);
        ASSERT_TRUE(ok(writer->append({0, static_cast<std::uint64_t>(k)}, tile_bytes({0, 1}, 9))));
        ASSERT_TRUE(ok(writer->close()));
      }
      EXPECT_EQ(TileWriter::create(path, {}).error().code, ErrorCode::usage);
      EXPECT_EQ(folder.files(), std::vector<std::string>{"a.slf"});
      EXPECT_EQ(TileStore::open(path)->find({0, 1})->state, TileState::stored);
    }
  refuse_unnamed_files(false);
  ASSERT_EQ(before != nullptr ? setenv("TMPDIR", kept.c_str(), 1) : unsetenv("TMPDIR"), 0);
}

TEST(TileWriter, ASecondWriterIsRefusedAtOnce) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  {
    TileWriter writer = create(path);
    const auto second = TileWriter::resume(path);
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::busy);
    EXPECT_THAT(second.error().message, HasSubstr("another writer"));
    EXPECT_TRUE(ok(writer.append({0, 0}, {})));
    EXPECT_TRUE(ok(writer.close()));
  }
  EXPECT_TRUE(ok(TileWriter::resume(path)));
}

TEST(TileWriter, WithoutCloseDropsWhatWasNotCommitted) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  std::optional<TileKey> last;
  {
    TileWriter writer = create(path);
    for (std::uint64_t i = 0; i < 2000; ++i) {
      if (i == 1000) {
        ASSERT_TRUE(ok(writer.commit()));
        last = writer.last();
        ASSERT_TRUE(last);
      }
      const TileKey key{0, i};
      const Bytes bytes = tile_bytes(key, 300);
      ASSERT_TRUE(ok(writer.append(key, bytes)));
      if (i < 1000) model[key] = bytes;
    }
    EXPECT_GT(writer.pending_bytes(), 0u);
  }
  std::erase_if(model, [&](const auto& tile) { return tile.first > *last; });
  expect_holds(path, model);
  auto writer = TileWriter::resume(path);
  ASSERT_TRUE(ok(writer));
  EXPECT_EQ(writer->last(), last);
}

TEST(TileWriter, CutsTheSameRecordsWhateverTheCommits) {
  TemporaryFolder folder;
  std::vector<std::pair<TileKey, Bytes>> tiles;
  for (std::uint64_t i = 0; i < 900; ++i) {
    const TileKey key{static_cast<std::uint8_t>(i / 400), i % 400 * (i > 800 ? 30 : 1)};
    tiles.emplace_back(key, tile_bytes(key, i * 7919 % 6000));
  }
  const auto build = [&](const std::string& path, std::size_t commit_every, bool reopen) {
    std::optional<TileWriter> writer = create(path);
    std::size_t since = 0;
    for (std::size_t i = 0; i < tiles.size(); ++i) {
      EXPECT_TRUE(ok(writer->append(tiles[i].first, tiles[i].second)));
      if (++since < commit_every) continue;
      since = 0;
      EXPECT_TRUE(ok(writer->commit()));
      if (!reopen) continue;
      writer.reset();
      writer = std::move(TileWriter::resume(path).value());
      const auto last = writer->last();
      while (last && tiles[i].first > *last) --i;
    }
    EXPECT_TRUE(ok(writer->close()));
  };
  // Which tiles share a record shows in where payloads lie relative to their neighbours.
  const auto cuts = [&](const std::string& path) {
    std::vector<std::pair<std::uint64_t, std::uint64_t>> result;
    auto store = TileStore::open(path);
    std::uint64_t end = 0;
    EXPECT_TRUE(ok(store->visit({0, 0}, {9, 0}, [&](const TileRef& tile) {
      const FileRange range = store->range(tile);
      if (tile.state == TileState::stored && (range.begin < end || range.begin > end + 8))
        result.emplace_back(tile.key.level, tile.key.index);
      if (tile.state == TileState::stored) end = range.end;
      return Result<void>();
    })));
    return result;
  };
  build(folder / "once", 100000, false);
  const auto expected = cuts(folder / "once");
  EXPECT_GT(expected.size(), 10u);
  for (const std::uint64_t every : {1u, 7u, 50u}) {
    const std::string path = folder / ("every" + std::to_string(every));
    build(path, every, false);
    EXPECT_EQ(cuts(path), expected) << every;
  }
  build(folder / "reopened", 310, true);
  EXPECT_EQ(cuts(folder / "reopened"), expected);
  EXPECT_EQ(contents(*TileStore::open(folder / "reopened")),
            contents(*TileStore::open(folder / "once")));
}

TEST(TileWriter, ReplacesTilesOfAllStates) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  {
    TileWriter writer = create(path);
    for (std::uint64_t i = 0; i < 600; ++i) {
      const TileKey key{static_cast<std::uint8_t>(i / 300), i % 300 * 2};
      model[key] = tile_bytes(key, 500);
      ASSERT_TRUE(ok(writer.append(key, model[key])));
    }
    ASSERT_TRUE(ok(writer.close()));
  }
  {
    auto writer = TileWriter::resume(path);
    ASSERT_TRUE(ok(writer));
    const auto set = [&](TileKey key, TileState state, std::size_t size) {
      const Bytes bytes = tile_bytes(key, size, 99);
      ASSERT_TRUE(
          ok(state == TileState::missing ? writer->drop(key) : writer->replace(key, bytes)));
      model.erase(key);
      if (state != TileState::missing) model[key] = bytes;
    };
    set({0, 0}, TileState::missing, 0);
    set({0, 10}, TileState::empty, 0);
    set({0, 11}, TileState::stored, 70000);
    set({0, 598}, TileState::missing, 0);
    set({1, 0}, TileState::stored, 1);
    set({1, 598}, TileState::missing, 0);
    set({1, 598}, TileState::stored, 12);
    EXPECT_EQ(writer->replace({1, 599}, {}).error().code, ErrorCode::usage);
    EXPECT_EQ(writer->replace({0, 599}, {}).error().code, ErrorCode::usage);
    EXPECT_EQ(writer->replace({1, 0}, {}, 1).error().code, ErrorCode::usage);
    ASSERT_TRUE(ok(writer->append({1, 600}, {})));
    ASSERT_TRUE(ok(writer->close()));
    model[{1, 600}] = {};
  }
  expect_holds(path, model);
}

TEST(TileWriter, FillsHolesBeforeARecord) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  {
    TileWriter writer = create(path);
    for (const TileKey key : {TileKey{0, 7}, TileKey{0, 9}, TileKey{1, 5}, TileKey{1, 20000000}}) {
      model[key] = tile_bytes(key, 300);
      ASSERT_TRUE(ok(writer.append(key, model[key])));
      writer.end_records();
    }
    ASSERT_TRUE(ok(writer.close()));
  }
  {
    auto writer = TileWriter::resume(path);
    ASSERT_TRUE(ok(writer));
    for (const TileKey key : {TileKey{0, 8}, TileKey{0, 6}, TileKey{0, 2}, TileKey{0, 7},
                              TileKey{1, 0}, TileKey{0, 3}, TileKey{1, 4}}) {
      model[key] = tile_bytes(key, 400, 9);
      ASSERT_TRUE(ok(writer->replace(key, model[key])));
    }
    EXPECT_EQ(writer->replace({1, 6}, {}).error().code, ErrorCode::usage);
    EXPECT_EQ(writer->replace({0, 10}, {}).error().code, ErrorCode::usage);
    ASSERT_TRUE(ok(writer->close()));
  }
  expect_holds(path, model);
}

// The number of the last commit, from the meta pages.
std::uint64_t transaction(const std::string& path) {
  const Bytes file = read_file(path);
  return std::max(load_le<std::uint64_t>(file.data() + 144),
                  load_le<std::uint64_t>(file.data() + 4096 + 144));
}

TEST(TileWriter, ReplacesTilesByThoseOfEarlierStatesAndBack) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  {
    TileWriter writer = create(path);
    for (std::uint64_t state = 0; state < 3; ++state)
      for (std::uint64_t i = 0; i < 40; ++i) {
        const TileKey key = in_state({0, i}, state);
        model[key] = state == 1 ? model[{0, i}] : tile_bytes(key, 300);
        ASSERT_TRUE(ok(state == 1 ? writer.append(key, {}, 1) : writer.append(key, model[key])));
      }
    ASSERT_TRUE(ok(writer.close()));
  }
  auto writer = TileWriter::resume(path);
  ASSERT_TRUE(ok(writer));
  for (std::uint64_t i = 0; i < 39; i += 3) {
    const TileKey own = in_state({0, i}, 1), same = in_state({0, i + 1}, 2);
    model[own] = tile_bytes(own, 70);
    ASSERT_TRUE(ok(writer->replace(own, model[own])));
    model[same] = model[{0, i + 1}];
    ASSERT_TRUE(ok(writer->replace(same, {}, 2)));
  }
  const TileKey key = in_state({0, 5}, 1);
  EXPECT_EQ(writer->replace(key, {}, 2).error().code, ErrorCode::usage);
  EXPECT_EQ(writer->replace(key, tile_bytes(key, 70), 1).error().code, ErrorCode::usage);
  ASSERT_TRUE(ok(writer->close()));
  expect_holds(path, model);
}

TEST(TileWriter, ReplacesManyTilesInOneCommitAndTouchesNoOtherRecord) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  {
    TileWriter writer = create(path);
    for (std::uint64_t i = 0; i < 600; ++i) {
      model[{1, i}] = tile_bytes({1, i}, 1000);
      ASSERT_TRUE(ok(writer.append({1, i}, model[{1, i}])));
    }
    ASSERT_TRUE(ok(writer.close()));
  }
  const std::uint64_t before = transaction(path);
  const auto places = [&] {
    std::vector<std::uint64_t> found;
    auto store = TileStore::open(path);
    for (const auto& [key, bytes] : model) found.push_back(store->range(*store->find(key)).begin);
    return found;
  };
  const auto old = places();
  {
    auto writer = TileWriter::resume(path);
    ASSERT_TRUE(ok(writer));
    std::uint64_t pending = 0;
    for (const std::uint64_t i : {599u, 3u, 200u, 201u, 4u, 200u}) {
      model[{1, i}] = tile_bytes({1, i}, 900, 5 + pending);
      ASSERT_TRUE(ok(writer->replace({1, i}, model[{1, i}])));
      EXPECT_GT(writer->pending_bytes(), pending);
      pending = writer->pending_bytes();
    }
    EXPECT_EQ(transaction(path), before);
    ASSERT_TRUE(ok(writer->commit()));
    EXPECT_EQ(writer->pending_bytes(), 0u);
    EXPECT_EQ(transaction(path), before + 1);
    ASSERT_TRUE(ok(writer->replace({1, 5}, {})));  // and is then dropped
  }
  expect_holds(path, model);
  const auto now = places();
  EXPECT_NE(now[3], old[3]);
  EXPECT_NE(now[599], old[599]);
  EXPECT_EQ(now[400], old[400]);
}

TEST(TileWriter, OverwritesBlobs) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  TileWriter writer = create(path);
  for (const std::size_t size : {10u, 100000u, 0u, 2000u}) {
    const Bytes bytes = tile_bytes({0, size}, size);
    ASSERT_TRUE(ok(writer.set_blob("b", bytes)));
    ASSERT_TRUE(ok(writer.commit()));
    auto store = TileStore::open(path);
    ASSERT_TRUE(ok(store));
    const auto blob = store->blob("b");
    ASSERT_TRUE(ok(blob));
    EXPECT_EQ(Bytes(blob->begin(), blob->end()), bytes);
    std::vector<Error> findings;
    store->check_structure(findings);
    EXPECT_TRUE(findings.empty());
  }
}

TEST(TileWriter, GrowsItsMap) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  Model model;
  {
    TileWriter writer = create(path);
    for (std::uint64_t i = 0; i < 40; ++i) {
      model[{0, i}] = tile_bytes({0, i}, 1 << 20);
      ASSERT_TRUE(ok(writer.append({0, i}, model[{0, i}])));
      if (i == 3) {
        ASSERT_TRUE(ok(writer.commit()));
      }
    }
    ASSERT_TRUE(ok(writer.close()));
  }
  expect_holds(path, model);
}

}  // namespace
}  // namespace slf::storage::testing
