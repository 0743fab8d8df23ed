// A container read by ranges: the same tiles as from the map, from few bytes, and no crash whatever
// the bytes are.
#include "storage/ranged_store.h"

#include <fstream>

#include "storage/internal/file_index.h"
#include "tests/storage/storage_testing.h"

namespace slf::storage::testing {
namespace {

class RangedStoreTest : public ::testing::Test {
 protected:
  static constexpr std::uint64_t kTiles = 3000;

  void SetUp() override {
    {
      TileWriter writer = create(path_);
      for (std::uint64_t i = 0; i < kTiles; ++i) {
        if (i % 7 == 3) continue;  // missing
        const std::size_t size = i % 5 == 0 ? 0 : 100 + i % 3000;
        ASSERT_TRUE(
            ok(writer.append({static_cast<std::uint8_t>(i / 1000), i}, tile_bytes({0, i}, size))));
      }
      ASSERT_TRUE(ok(writer.close()));
    }
    file_ = read_file(path_);
  }

  // Gives a store what it wants until a call succeeds or fails for another reason.
  template <class Call>
  auto complete(RangedStore& store, const Bytes& file, const Call& call) {
    for (int round = 0;; ++round) {
      auto result = call();
      const auto needed = store.take_needed_ranges();
      if (result || needed.empty() || round == 100) return result;
      ++round_trips_;
      for (const FileRange& range : needed) {
        EXPECT_LE(range.end, file.size());
        fetched_ += range.end - range.begin;
        store.add(range.begin, Bytes(file.begin() + static_cast<std::ptrdiff_t>(range.begin),
                                     file.begin() + static_cast<std::ptrdiff_t>(range.end)));
      }
    }
  }

  TemporaryFolder folder_;
  const std::string path_ = folder_ / "ranged.slf";
  Bytes file_;
  std::uint64_t fetched_ = 0;
  int round_trips_ = 0;
};

TEST_F(RangedStoreTest, FindsWhatTheMapHas) {
  const auto mapped = TileStore::open(path_);
  ASSERT_TRUE(ok(mapped));
  RangedStore store("ranged.slf", file_.size());
  ASSERT_TRUE(ok(complete(store, file_, [&] { return store.open(); })));
  const auto note = complete(store, file_, [&] { return store.blob("manifest.json"); });
  ASSERT_TRUE(ok(note));
  EXPECT_EQ(Bytes(note->begin(), note->end()), bytes_of("{}"));
  for (std::uint64_t i = 0; i < kTiles + 10; ++i) {
    const TileKey key{static_cast<std::uint8_t>(i / 1000), i};
    const auto expected = mapped->find(key);
    const auto found = complete(store, file_, [&] { return store.find(key); });
    ASSERT_TRUE(ok(expected));
    ASSERT_TRUE(ok(found)) << i;
    ASSERT_EQ(found->state, expected->state) << i;
    if (found->state != TileState::stored) continue;
    const FileRange range = mapped->range(*expected);
    ASSERT_EQ(found->payload.begin, range.begin) << i;
    ASSERT_EQ(found->payload.end, range.end) << i;
    ASSERT_EQ(found->checksum, expected->checksum) << i;
  }
}

TEST_F(RangedStoreTest, NeedsNoPayloadsToFindTiles) {
  RangedStore store("ranged.slf", file_.size());
  ASSERT_TRUE(ok(complete(store, file_, [&] { return store.open(); })));
  for (std::uint64_t i = 0; i < kTiles; ++i)
    ASSERT_TRUE(ok(complete(store, file_, [&] {
      return store.find({static_cast<std::uint8_t>(i / 1000), i});
    })));
  EXPECT_LT(fetched_, file_.size() / 4);
}

TEST_F(RangedStoreTest, FetchesForManyTilesTogether) {
  RangedStore store("ranged.slf", file_.size());
  ASSERT_TRUE(ok(complete(store, file_, [&] { return store.open(); })));
  round_trips_ = 0;
  (void)complete(store, file_, [&] {
    Result<RangedTile> last;
    for (std::uint64_t i = 0; i < kTiles; i += 50)
      if (auto found = store.find({static_cast<std::uint8_t>(i / 1000), i}); !found) last = found;
    return last;
  });
  EXPECT_LE(round_trips_, 4);  // branch, leaves, heads of records, and heads that are longer
}

TEST_F(RangedStoreTest, RefusesDamageOrFindsTheSame) {
  std::mt19937_64 random(7);
  for (int trial = 0; trial < 300; ++trial) {
    Bytes damaged = file_;
    for (int k = 0; k < 3; ++k)
      damaged[random() % damaged.size()] ^= static_cast<std::byte>(1 << random() % 8);
    if (trial % 10 == 0) damaged.resize(random() % damaged.size());
    RangedStore store("damaged.slf", damaged.size());
    if (!complete(store, damaged, [&] { return store.open(); })) continue;
    for (std::uint64_t i = 0; i < kTiles; i += 101) {
      const auto found = complete(store, damaged, [&] {
        return store.find({static_cast<std::uint8_t>(i / 1000), i});
      });
      if (found && found->state == TileState::stored) {
        EXPECT_LE(found->payload.end, damaged.size());
      }
    }
  }
}

TEST_F(RangedStoreTest, AnEmptyFileIsRefusedAndNothingIsWanted) {
  RangedStore store("empty.slf", 0);
  const auto opened = store.open();
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().code, ErrorCode::bad_file) << opened.error().message;
  EXPECT_TRUE(store.take_needed_ranges().empty());
}

TEST_F(RangedStoreTest, AnIndexSavesRoundTrips) {
  ASSERT_TRUE(ok(write_index(path_)));
  const Bytes indexed = read_file(path_);
  ASSERT_GT(indexed.size(), file_.size());
  EXPECT_TRUE(std::equal(file_.begin(), file_.end(), indexed.begin()));
  const auto mapped = TileStore::open(path_);
  ASSERT_TRUE(ok(mapped));
  std::vector<Error> findings;
  mapped->check_structure(findings);
  EXPECT_TRUE(findings.empty());

  RangedStore store("ranged.slf", indexed.size());
  ASSERT_TRUE(ok(complete(store, indexed, [&] { return store.open(); })));
  EXPECT_LE(round_trips_, 4);  // the start, the footer, the directory, the core
  for (std::uint64_t i = 0; i < kTiles; ++i) {
    const TileKey key{static_cast<std::uint8_t>(i / 1000), i};
    const auto found = complete(store, indexed, [&] { return store.find(key); });
    const auto expected = mapped->find(key);
    ASSERT_TRUE(ok(found)) << i;
    ASSERT_EQ(found->state, expected->state) << i;
    ASSERT_EQ(found->checksum, expected->checksum) << i;
  }
  EXPECT_LE(round_trips_, 4 + 3);  // one for each level
}

TEST_F(RangedStoreTest, AnIndexIsTheSameForTheSameFile) {
  ASSERT_TRUE(ok(write_index(path_)));
  const Bytes once = read_file(path_);
  ASSERT_TRUE(ok(write_index(path_)));
  EXPECT_EQ(read_file(path_), once);
}

/// The most memory that was resident since reset_peak(), in bytes.
std::uint64_t peak_memory() {
  std::ifstream status("/proc/self/status");
  std::uint64_t kib = 0;
  for (std::string word; status >> word;)
    if (word == "VmHWM:") status >> kib;
  return kib << 10;
}

bool reset_peak() {
  std::ofstream file("/proc/self/clear_refs");
  return static_cast<bool>(file << 5 << std::flush);
}

TEST(Index, IsWrittenWithoutTheFileInMemory) {
  const TemporaryFolder folder;
  const std::string path = folder / "large.slf";
  constexpr std::uint64_t kTileBytes = 4000, kTiles = 45'000;
  {
    TileWriter writer = create(path);
    for (std::uint64_t i = 0; i < kTiles; ++i) {
      ASSERT_TRUE(ok(writer.append({0, i}, Bytes(kTileBytes, std::byte{7}))));
      if (i % 1000 == 0) {
        ASSERT_TRUE(ok(writer.commit()));
      }
    }
    ASSERT_TRUE(ok(writer.close()));
  }
  if (!reset_peak()) GTEST_SKIP() << "this kernel does not reset the peak of a process's memory";
  const std::uint64_t before = peak_memory();
  ASSERT_TRUE(ok(write_index(path)));
  EXPECT_LT(peak_memory() - before, kTileBytes * kTiles / 4);
}

TEST_F(RangedStoreTest, AnIndexOfAnEarlierStateIsIgnored) {
  ASSERT_TRUE(ok(write_index(path_)));
  {
    auto writer = TileWriter::resume(path_);
    ASSERT_TRUE(ok(writer));
    const TileKey key{2, kTiles + 5};
    ASSERT_TRUE(ok(writer->append(key, tile_bytes(key, 500))));
    ASSERT_TRUE(ok(writer->close()));
  }
  const Bytes resumed = read_file(path_);
  RangedStore store("ranged.slf", resumed.size());
  ASSERT_TRUE(ok(complete(store, resumed, [&] { return store.open(); })));
  const auto found = complete(store, resumed, [&] { return store.find({2, kTiles + 5}); });
  ASSERT_TRUE(ok(found));
  EXPECT_EQ(found->state, TileState::stored);
}

TEST_F(RangedStoreTest, ADamagedIndexIsIgnored) {
  ASSERT_TRUE(ok(write_index(path_)));
  const Bytes indexed = read_file(path_);
  const auto mapped = TileStore::open(path_);
  std::mt19937_64 random(11);
  for (int trial = 0; trial < 200; ++trial) {
    Bytes damaged = indexed;
    damaged[file_.size() + random() % (damaged.size() - file_.size())] ^=
        static_cast<std::byte>(1 << random() % 8);
    if (trial % 10 == 0) damaged.resize(file_.size() + random() % (damaged.size() - file_.size()));
    RangedStore store("damaged.slf", damaged.size());
    ASSERT_TRUE(ok(complete(store, damaged, [&] { return store.open(); })));
    for (std::uint64_t i = 0; i < kTiles; i += 97) {
      const TileKey key{static_cast<std::uint8_t>(i / 1000), i};
      const auto found = complete(store, damaged, [&] { return store.find(key); });
      ASSERT_TRUE(ok(found));
      ASSERT_EQ(found->checksum, mapped->find(key)->checksum);
    }
  }
}

TEST_F(RangedStoreTest, SaysWhatIsNoField) {
  const Bytes text = bytes_of(std::string(9000, 'x'));
  RangedStore store("text.slf", text.size());
  const auto open = complete(store, text, [&] { return store.open(); });
  ASSERT_FALSE(open);
  EXPECT_EQ(open.error().code, ErrorCode::bad_file);
  RangedStore empty("empty.slf", 0);
  EXPECT_FALSE(empty.open());
}

}  // namespace
}  // namespace slf::storage::testing
