// Readers beside a writer, in threads and processes, and containers nobody may write to.
#include <gmock/gmock.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "tests/storage/storage_testing.h"

namespace slf::storage::testing {
namespace {

using ::testing::HasSubstr;

Bytes expected_tile(std::uint64_t i) { return tile_bytes({0, i}, 200 + i * 37 % 3000); }

// Every tile from the first to the snapshot's last must be there and right.
std::uint64_t check_whole(const TileStore& store) {
  std::uint64_t count = 0;
  const auto visited = store.visit({0, 0}, {255, 0}, [&](const TileRef& tile) -> Result<void> {
    if (tile.key.index != count) return fail(ErrorCode::differs, "a tile is lost");
    if (auto good = store.check(tile); !good) return good;
    if (!std::ranges::equal(tile.payload, expected_tile(count)))
      return fail(ErrorCode::differs, "a wrong tile");
    ++count;
    return {};
  });
  EXPECT_TRUE(ok(visited));
  return count;
}

TEST(Concurrency, EveryReaderKeepsItsSnapshotWhileAWriterGoesOn) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  TileWriter writer = create(path);
  std::atomic<bool> done = false;
  std::atomic<int> opened = 0;
  const auto read = [&] {
    std::vector<TileStore> held;  // old snapshots, looked at again and again
    std::vector<std::uint64_t> counts;
    while (!done || held.empty()) {
      auto store = TileStore::open(path);
      ASSERT_TRUE(ok(store));
      ++opened;
      const std::uint64_t count = check_whole(*store);
      if (!counts.empty()) {
        EXPECT_GE(count, counts.back());
      }
      held.push_back(std::move(*store));
      counts.push_back(count);
      for (std::size_t i = 0; i < held.size(); ++i) EXPECT_EQ(check_whole(held[i]), counts[i]);
      if (held.size() > 4) {
        held.erase(held.begin());
        counts.erase(counts.begin());
      }
    }
  };
  std::vector<std::thread> readers;
  for (int i = 0; i < 4; ++i) readers.emplace_back(read);
  for (std::uint64_t i = 0; i < 1200; ++i) {
    EXPECT_TRUE(ok(writer.append({0, i}, expected_tile(i))));
    if (i % 10 == 9) {
      EXPECT_TRUE(ok(writer.set_blob("progress", bytes_of(std::to_string(i)))));
      EXPECT_TRUE(ok(writer.commit()));
      // Readers come at many states of the file, however the threads are scheduled.
      for (int wait = 0; wait < 1000 && opened < static_cast<int>(i / 60); ++wait)
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  EXPECT_TRUE(ok(writer.close()));
  done = true;
  for (std::thread& reader : readers) reader.join();
  EXPECT_GT(opened, 4);
  auto store = TileStore::open(path);
  EXPECT_EQ(check_whole(*store), 1200u);
  std::vector<Error> findings;
  store->check_structure(findings);
  EXPECT_TRUE(findings.empty());
}

// The pages a snapshot needs stay, through many commits and rewrites of the same records.
TEST(Concurrency, AnOldSnapshotOutlivesManyCommits) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  TileWriter writer = create(path);
  for (std::uint64_t i = 0; i < 200; ++i) ASSERT_TRUE(ok(writer.append({0, i}, expected_tile(i))));
  ASSERT_TRUE(ok(writer.append({1, 0}, {})));  // ends level 0, so that it is all cut
  ASSERT_TRUE(ok(writer.commit()));
  auto old = TileStore::open(path);
  ASSERT_TRUE(ok(old));
  for (std::uint64_t i = 0; i < 300; ++i) {
    ASSERT_TRUE(ok(writer.replace({0, i % 200}, tile_bytes({}, 4000, 5))));
    ASSERT_TRUE(ok(writer.commit()));
  }
  EXPECT_EQ(check_whole(*old), 200u);
  EXPECT_FALSE(
      std::ranges::equal(TileStore::open(path)->find({0, 7})->payload, old->find({0, 7})->payload));
}

TEST(Concurrency, FreedPagesAreReusedWhenNobodyReadsThem) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  TileWriter writer = create(path);
  ASSERT_TRUE(ok(writer.append({0, 0}, tile_bytes({}, 100000))));
  ASSERT_TRUE(ok(writer.append({1, 0}, {})));
  ASSERT_TRUE(ok(writer.commit()));
  for (int i = 0; i < 100; ++i) {
    ASSERT_TRUE(ok(writer.replace({0, 0}, tile_bytes({}, 100000, 5))));
    ASSERT_TRUE(ok(writer.commit()));
  }
  EXPECT_LT(std::filesystem::file_size(path), 1000000u);
}

TEST(Concurrency, FreedPagesAreReusedAfterAReaderOpensTheFileAgain) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  TileWriter writer = create(path);
  Bytes tile = tile_bytes({}, 100000), seen;
  ASSERT_TRUE(ok(writer.append({0, 0}, tile)));
  ASSERT_TRUE(ok(writer.append({1, 0}, {})));
  ASSERT_TRUE(ok(writer.commit()));
  std::optional<TileStore> reader;
  for (std::uint8_t i = 0; i < 100; ++i) {
    if (i % 4 == 0) {
      reader.reset();
      reader = std::move(TileStore::open(path).value());
      seen = tile;
    }
    tile = tile_bytes({}, 100000, i);
    ASSERT_TRUE(ok(writer.replace({0, 0}, tile)));
    ASSERT_TRUE(ok(writer.commit()));
    ASSERT_TRUE(std::ranges::equal(reader->find({0, 0})->payload, seen)) << int{i};
  }
  EXPECT_LT(std::filesystem::file_size(path), 2000000u);
}

TEST(Concurrency, AWriterWaitsForReadersOfOlderSnapshotsByRefusing) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  std::optional<TileStore> old;
  {
    TileWriter writer = create(path);
    old = std::move(TileStore::open(path).value());
    ASSERT_TRUE(ok(writer.append({0, 0}, {})));
    ASSERT_TRUE(ok(writer.close()));
  }
  const auto refused = TileWriter::resume(path);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::failed);
  EXPECT_THAT(refused.error().message, HasSubstr("older state"));
  old = std::move(TileStore::open(path).value());  // the current one does no harm
  EXPECT_TRUE(ok(TileWriter::resume(path)));
}

TEST(Concurrency, ManyStoresAndAWriterShareAProcess) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  TileWriter writer = create(path);
  std::vector<TileStore> stores;
  for (std::uint64_t i = 0; i < 300; ++i) {
    ASSERT_TRUE(ok(writer.set_blob("i", bytes_of(std::to_string(i)))));
    ASSERT_TRUE(ok(writer.commit()));
    stores.push_back(std::move(TileStore::open(path).value()));
    if (i % 3 == 0) stores.erase(stores.begin());  // closing one must not unlock the others
  }
  EXPECT_EQ(TileWriter::resume(path).error().code, ErrorCode::busy);
  for (std::size_t k = 1; k < stores.size(); ++k) EXPECT_TRUE(ok(stores[k].blob("i")));
  EXPECT_TRUE(ok(writer.close()));
}

// Runs `body` in a child process; returns its exit code.
template <class Body>
int in_child(const Body& body) {
  const pid_t child = fork();
  if (child == 0) _exit(body());
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 100 + WTERMSIG(status);
}

TEST(Concurrency, AWriterOfAnotherProcessIsRefusedToo) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  TileWriter writer = create(path);
  EXPECT_EQ(in_child([&] {
              const auto second = TileWriter::resume(path);
              return second ? 0 : static_cast<int>(second.error().code);
            }),
            static_cast<int>(ErrorCode::busy));
}

TEST(Concurrency, AReaderNeedsNoWritePermissionAnywhere) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  {
    TileWriter writer = create(path);
    for (std::uint64_t i = 0; i < 10; ++i) ASSERT_TRUE(ok(writer.append({0, i}, expected_tile(i))));
    ASSERT_TRUE(ok(writer.close()));
  }
  ASSERT_EQ(chmod(path.c_str(), 0444), 0);
  ASSERT_EQ(chmod(folder.path().c_str(), 0555), 0);
  const int result = in_child([&] {
    if (geteuid() == 0 && (setegid(65534) != 0 || seteuid(65534) != 0)) return 99;
    if (access(folder.path().c_str(), W_OK) == 0 && geteuid() == getuid()) return 99;
    auto store = TileStore::open(path);
    if (!store || check_whole(*store) != 10) return 1;
    const auto writer = TileWriter::resume(path);
    if (writer || writer.error().code != ErrorCode::io) return 2;
    const auto made = TileWriter::create(folder / "b.slf", {});
    return !made && made.error().code == ErrorCode::io ? 0 : 3;
  });
  ASSERT_EQ(chmod(folder.path().c_str(), 0755), 0);
  if (result == 99) GTEST_SKIP() << "cannot give up the right to write";
  EXPECT_EQ(result, 0);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

}  // namespace
}  // namespace slf::storage::testing
