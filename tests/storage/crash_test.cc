// Killed writers, failing system calls, full disks: what was committed stays, and resuming
// reaches the same content.
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include "tests/storage/failing_calls.h"
#include "tests/storage/storage_testing.h"

namespace slf::storage::testing {
namespace {

using ::testing::HasSubstr;

constexpr std::uint64_t kAllTiles = 240;

/// Of each level 50 tiles in two states.
TileKey key_of(std::uint64_t i) {
  return in_state({static_cast<std::uint8_t>(i / 100), i % 50}, i % 100 / 50);
}
std::uint64_t count_to(TileKey last) { return last.level * 100 + last.state * 50 + last.index + 1; }

/// Whether a tile is the same as that of the first state.
bool is_same(std::uint64_t i) { return i % 100 >= 50 && i % 3 != 0; }

Bytes written_tile(std::uint64_t i) {
  return is_same(i) ? written_tile(i - 50) : tile_bytes(key_of(i), i * 131 % 9000 + 1);
}

// Appends what is not there yet, with a commit every 20 tiles. `report` hears of commits.
template <class Report>
Result<void> build(const std::string& path, const Report& report) {
  auto writer =
      std::filesystem::exists(path) ? TileWriter::resume(path) : TileWriter::create(path, {});
  if (!writer) return tl::unexpected(writer.error());
  const std::optional<TileKey> last = writer->last();
  for (std::uint64_t i = 0; i < kAllTiles; ++i) {
    const TileKey key = key_of(i);
    if (!last || key > *last)
      if (auto done =
              is_same(i) ? writer->append(key, {}, 1) : writer->append(key, written_tile(i));
          !done)
        return done;
    if (i % 20 != 19) continue;
    if (auto done = writer->commit(); !done) return done;
    const auto now = writer->last();
    report(now ? count_to(*now) : 0);
  }
  auto done = writer->close();
  if (done) report(kAllTiles);
  return done;
}

// Whatever is in the file is right, and there are at least `committed` tiles.
void expect_kept(const std::string& path, std::uint64_t committed) {
  if (!std::filesystem::exists(path)) {
    EXPECT_EQ(committed, 0u);
    return;
  }
  auto store = TileStore::open(path);
  ASSERT_TRUE(ok(store));
  std::vector<Error> findings;
  store->check_structure(findings);
  for (const Error& finding : findings) ADD_FAILURE() << finding.message;
  std::uint64_t i = 0;
  for (const auto& [key, bytes] : contents(*store)) {
    EXPECT_EQ(key, key_of(i));
    EXPECT_EQ(bytes, written_tile(i));
    ++i;
  }
  EXPECT_GE(i, committed);
}

void expect_complete(const std::string& path) {
  const auto done = build(path, [](std::uint64_t) {});
  ASSERT_TRUE(ok(done));
  expect_kept(path, kAllTiles);
  EXPECT_EQ(contents(*TileStore::open(path)).size(), kAllTiles);
}

TEST(Crash, AKilledWriterLosesNothingItCommitted) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  std::mt19937 random(3);
  int killed = 0;
  for (int round = 0; killed < 200 && round < 2000 && !HasFailure(); ++round) {
    int pipes[2];
    ASSERT_EQ(pipe(pipes), 0);
    const pid_t child = fork();
    if (child == 0) {
      const auto done =
          build(path, [&](std::uint64_t count) { (void)!::write(pipes[1], &count, sizeof count); });
      _exit(done ? 0 : 1);
    }
    ::close(pipes[1]);
    usleep(random() % 2500);
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    std::uint64_t committed = 0;
    while (::read(pipes[0], &committed, sizeof committed) == sizeof committed) {
    }
    ::close(pipes[0]);
    if (WIFSIGNALED(status)) ++killed;
    if (WIFEXITED(status)) {
      EXPECT_EQ(WEXITSTATUS(status), 0);
    }
    expect_kept(path, committed);
    if (round % 10 == 0) expect_complete(path);
    if (committed == kAllTiles || round % 10 == 0) std::filesystem::remove(path);
  }
  EXPECT_EQ(killed, 200);
  expect_complete(path);
}

void fail_each_call(int error, bool all_later) {
  bool failed = true;
  int calls = 0;
  for (; failed && !::testing::Test::HasFailure(); ++calls) {
    TemporaryFolder folder;
    const std::string path = folder / "a.slf";
    std::uint64_t committed = 0;
    fail_after(calls, error, all_later);
    const auto done = build(path, [&](std::uint64_t count) { committed = count; });
    failed = has_failed();
    fail_after(-1, 0, false);
    if (!done) {
      EXPECT_TRUE(failed);
      EXPECT_TRUE(done.error().code == ErrorCode::io || done.error().code == ErrorCode::failed)
          << done.error().message;
      EXPECT_THAT(done.error().message, HasSubstr("a.slf"));
    }
    expect_kept(path, committed);
    expect_complete(path);
  }
  EXPECT_GT(calls, 30);
}

TEST(Crash, AnyOneFailingCallLosesNothing) { fail_each_call(ENOSPC, false); }
TEST(Crash, AnyHalfWriteLosesNothing) { fail_each_call(EIO, false); }
TEST(Crash, NothingIsLostWhenAllCallsFailFromSomePointOn) { fail_each_call(ENOSPC, true); }

// What is replaced stays whole until the new file is in its place, and both are durable then.
TEST(Crash, APublishThatFailsLeavesTheOldFileAndTheNewOne) {
  bool failed = true;
  int calls = 0, kept = 0;
  for (; failed && !HasFailure(); ++calls) {
    TemporaryFolder folder;
    const std::string path = folder / "a.slf", draft = path + ".unfinished";
    const Model before{{{0, 1}, tile_bytes({0, 1}, 5000)}};
    const Model after{{{0, 2}, tile_bytes({0, 2}, 7000)}};
    const auto add = [](TileWriter& writer, const Model& model) {
      for (const auto& [key, bytes] : model) ASSERT_TRUE(ok(writer.append(key, bytes)));
    };
    TileWriter old = create(path);
    add(old, before);
    ASSERT_TRUE(ok(old.close()));
    TileWriter writer = create(draft);
    add(writer, after);
    EXPECT_EQ(writer.publish(path, Existing::keep).error().code, ErrorCode::usage);
    expect_holds(path, before);
    auto again = TileWriter::resume(draft);
    ASSERT_TRUE(ok(again));
    fail_after(calls, ENOSPC, false);
    const auto published = again->publish(path, Existing::replace);
    failed = has_failed();
    fail_after(-1, 0, false);
    const bool renamed = !std::filesystem::exists(draft);
    EXPECT_TRUE(renamed || !published);
    expect_holds(path, renamed ? after : before);
    if (!published) {
      EXPECT_EQ(published.error().code, ErrorCode::io);
      ++kept;
    }
    if (!renamed) {
      expect_holds(draft, after);
    }
  }
  EXPECT_GE(kept, 2);  // syncs of the file and of its folder
}

TEST(Crash, ACommitThatFailedCanBeTriedAgain) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  TileWriter writer = create(path);
  Model model;
  for (std::uint64_t i = 0; i < 100; ++i) {
    model[{0, i}] = tile_bytes({0, i}, 5000);
    ASSERT_TRUE(ok(writer.append({0, i}, model[{0, i}])));
  }
  fail_after(0, ENOSPC, false);
  const auto full = writer.commit();
  fail_after(-1, 0, false);
  ASSERT_FALSE(full);
  EXPECT_EQ(full.error().code, ErrorCode::io);
  EXPECT_THAT(full.error().message, HasSubstr("free some space"));
  ASSERT_TRUE(ok(writer.close()));
  expect_holds(path, model);
}

// LMDB may have committed when a later step of a commit fails: nothing may be written twice.
TEST(Crash, AnyCommitThatFailedCanBeTriedAgain) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  TileWriter writer = create(path);
  Model model;
  int failures = 0;
  for (std::uint64_t k = 0; k < 300; ++k) {
    SCOPED_TRACE(k);
    const TileKey added{0, k}, replaced{0, k * 7 % (k + 1)};
    const std::size_t bytes = 3000 + k * 7919 % 90000;
    const auto put = [&] {
      if (!writer.last() || *writer.last() < added) {
        ASSERT_TRUE(ok(writer.append(added, model[added] = tile_bytes(added, bytes))));
        writer.end_records();
      }
      if (replaced == added) return;
      model[replaced] = tile_bytes(replaced, 90000 - bytes / 2);
      ASSERT_TRUE(ok(writer.replace(replaced, model[replaced])));
    };
    put();
    fail_after(static_cast<int>(k % 9), ENOSPC, false);
    const auto committed = writer.commit();
    fail_after(-1, 0, false);
    if (committed) continue;
    ++failures;
    if (const auto again = writer.commit(); !again) {  // LMDB does not know what it has written
      ASSERT_THAT(again.error().message, HasSubstr("open it again"));
      { const TileWriter closed = std::move(writer); }
      auto resumed = TileWriter::resume(path);
      ASSERT_TRUE(ok(resumed));
      writer = std::move(*resumed);
      put();
      ASSERT_TRUE(ok(writer.commit()));
    }
  }
  EXPECT_GT(failures, 100);
  ASSERT_TRUE(ok(writer.close()));
  expect_holds(path, model);
}

TEST(Crash, AFullDiskIsAnErrorThatSaysSo) {
  TemporaryFolder folder;
  const std::string path = folder / "a.slf";
  const pid_t child = fork();
  if (child == 0) {
    signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{500000, 500000};
    setrlimit(RLIMIT_FSIZE, &limit);
    const auto done = build(path, [](std::uint64_t) {});
    _exit(!done && done.error().code == ErrorCode::io &&
                  done.error().message.find("free some space") != std::string::npos
              ? 0
              : 1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  expect_kept(path, 20);
  expect_complete(path);
}

}  // namespace
}  // namespace slf::storage::testing
