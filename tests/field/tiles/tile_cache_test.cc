// TileCache on its own: what readers find without a lock, and what the budget removes.

#include "field/tiles/tile_cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <random>
#include <set>
#include <sstream>
#include <thread>

#include "field/geometry/section.h"
#include "slf/scene.h"
#include "tests/field/field_testing.h"
#include "tests/sanitized.h"

namespace slf {
namespace {

using testing::build_and_open;
using testing::lossless_options;
using testing::TemporaryFolder;

constexpr unsigned kLevel = 1;
constexpr std::uint64_t kRoomy = 64 << 20;

class TileCacheTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    const auto scene = std::move(*make_analytic_scene("balls"));
    field_ = new Field(*build_and_open(*scene, *folder_ / "balls.slf", lossless_options(4, 8, 1)));
  }
  static void TearDownTestSuite() {
    delete field_;
    delete folder_;
  }
  static TileKey key(std::uint64_t index) { return {kLevel, index}; }
  static std::uint64_t tiles() { return tile_count(kLevel, 0); }
  /// A tile with something to see in it.
  static TileKey stored(std::uint64_t from = 0) {
    while (field_->file().store().find(key(from))->state != storage::TileState::stored) ++from;
    return key(from);
  }
  static TilePage* find(const TileCache& cache, TileKey at) {
    const TileSections sections = sections_of(at, 0);
    return [&] {
      TilePage* page = cache.page_table(at.level).find(sections.entry.index, sections.exit.index);
      return page && page->state != 0 ? page : nullptr;
    }();
  }
  static std::vector<std::byte> samples(TileKey at) {
    const auto ref = field_->file().store().find(at);
    if (ref->state != storage::TileState::stored) return {};
    std::vector<std::byte> bytes(field_->file().tile_shape(at).bytes());
    EXPECT_TRUE(testing::read(field_->file(), *ref, bytes));
    return bytes;
  }

  static inline TemporaryFolder* folder_ = nullptr;
  static inline Field* field_ = nullptr;
};

/// What the kernel says of the memory at an address (VmFlags of /proc/self/smaps).
std::string memory_flags(const void* address) {
  const auto at = reinterpret_cast<std::uintptr_t>(address);
  std::ifstream maps("/proc/self/smaps");
  bool is_there = false;
  for (std::string line; std::getline(maps, line);) {
    std::uint64_t begin = 0, end = 0;
    char dash = 0;
    if (std::istringstream range(line); range >> std::hex >> begin >> dash >> end && dash == '-')
      is_there = at >= begin && at < end;
    if (is_there && line.starts_with("VmFlags:")) return line + " ";
  }
  return {};
}

// Otherwise a tile would take 2 MiB where huge pages are the rule.
TEST(PageTable, HasNoHugePages) {
  if (!std::ifstream("/sys/kernel/mm/transparent_hugepage/enabled")) GTEST_SKIP();
  const PageTable table = PageTable::make(2048, 2048);
  EXPECT_NE(memory_flags(table.pages()).find(" nh "), std::string::npos)
      << memory_flags(table.pages());
}

TEST_F(TileCacheTest, ReadersFindWhatWasLoaded) {
  TileCache cache(field_->file(), kRoomy);
  const TileKey at = stored();
  EXPECT_EQ(find(cache, at), nullptr);
  ASSERT_TRUE(cache.load(std::vector{at}));
  TilePage* page = find(cache, at);
  ASSERT_TRUE(page);
  EXPECT_TRUE(page->state & TilePage::kLoaded);
  const auto expected = samples(at);
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), page->color.load()));
  EXPECT_EQ(page->depth, page->color + field_->file().tile_shape(at).color_bytes());
}

TEST_F(TileCacheTest, StampsOfAFrameAreNotThoseOfOthersOrOfRemovedTiles) {
  for (const std::uint32_t frame :
       {0u, 1u, TilePage::kStamps - 1, TilePage::kStamps, 0xFFFFFFFFu}) {
    const std::uint64_t stamp = TilePage::stamp(frame);
    EXPECT_LT(stamp, TilePage::kRemoved);
    EXPECT_NE(stamp, TilePage::kNotFound);
    EXPECT_NE(stamp, TilePage::stamp(frame + 1));
  }
}

TEST_F(TileCacheTest, StampsAreTakenFromTilesBeforeTheyComeAgainAndFromTilesThatAreRemoved) {
  TileCache cache(field_->file(), 1);
  const TileKey at = stored();
  auto pins = cache.load(std::vector{at});
  ASSERT_TRUE(pins);
  TilePage* page = find(cache, at);
  ASSERT_TRUE(page);
  const std::uint64_t word = page->found;
  EXPECT_EQ(word, TilePage::found_word(sample_offset(page->color), TilePage::kNotFound));
  const std::uint64_t stamp = TilePage::stamp(cache.begin_frame());
  page->found = word | stamp;  // as a renderer does
  std::uint32_t frame = cache.begin_frame();
  EXPECT_EQ(page->found, word | stamp);
  while (TilePage::stamp(frame) != stamp) frame = cache.begin_frame();
  EXPECT_EQ(page->found, word);
  pins->clear();
  EXPECT_EQ(page->found, word | TilePage::kRemoved);
}

TEST_F(TileCacheTest, FramesShareANumberWhileThereIsAmpleRoomAndNoneOfThemListsTiles) {
  TileCache cache(field_->file(), 64 << 10);
  const std::uint32_t first = cache.begin_frame(false);
  EXPECT_EQ(cache.begin_frame(false), first);
  const std::uint32_t listing = cache.begin_frame(true);
  EXPECT_NE(listing, first);
  EXPECT_NE(cache.begin_frame(true), listing);
  const std::uint32_t later = cache.begin_frame(false);
  EXPECT_EQ(cache.begin_frame(false), later);
  for (std::uint64_t k = 0; cache.statistics().decoded_bytes < 60 << 10; ++k) {
    ASSERT_LT(k, tiles());
    ASSERT_TRUE(cache.load(std::vector{key(k)}));
  }
  EXPECT_NE(cache.begin_frame(false), later);
  EXPECT_NE(cache.begin_frame(false), later + 1);
}

TEST_F(TileCacheTest, WhatWasUsedLongestAgoMakesRoom) {
  TileCache cache(field_->file(), 64 << 10);
  const TileKey first = stored(), second = stored(first.index + 1);
  ASSERT_TRUE(cache.load(std::vector{first, second}));
  const std::uint32_t frame = cache.begin_frame();
  find(cache, first)->used = frame;  // as a renderer does
  for (std::uint64_t k = second.index + 1; find(cache, second); ++k) {
    ASSERT_LT(k, tiles());
    ASSERT_TRUE(cache.load(std::vector{key(k)}));
    EXPECT_LE(cache.statistics().decoded_bytes, 64u << 10);
    EXPECT_TRUE(find(cache, first));
  }
}

TEST_F(TileCacheTest, PinnedTilesStayAndOnlyTheyExceedTheBudget) {
  TileCache cache(field_->file(), 1);
  const TileKey at = stored();
  auto pins = cache.load(std::vector{at});
  ASSERT_TRUE(pins);
  EXPECT_TRUE(find(cache, at));
  EXPECT_GT(cache.statistics().decoded_bytes, 1u);
  pins->clear();
  EXPECT_FALSE(find(cache, at));
  EXPECT_EQ(cache.statistics().decoded_bytes, 0u);
}

TEST_F(TileCacheTest, AReaderKeepsRemovedTilesAliveUntilItIsDone) {
  TileCache cache(field_->file(), 1);
  const TileKey at = stored();
  const auto expected = samples(at);
  TileCache::Reader reader(cache.epochs());
  auto pins = cache.load(std::vector{at});
  ASSERT_TRUE(pins);
  {
    const TileCache::ReadScope scope(reader);
    TilePage* page = find(cache, at);
    ASSERT_TRUE(page);
    pins->clear();
    EXPECT_FALSE(find(cache, at));
    EXPECT_GT(cache.statistics().decoded_bytes, 0u);
    EXPECT_TRUE(std::equal(expected.begin(), expected.end(), page->color.load()));
  }
  ASSERT_TRUE(cache.load(std::vector{at}));
  EXPECT_EQ(cache.statistics().decoded_bytes, 0u);
}

TEST_F(TileCacheTest, ThreadsThatWaitForAReaderDoNotSpendTheSameRoomTwice) {
  const std::vector<TileKey> wanted{stored(), stored(stored().index + 1)};
  for (int repetition = 0; repetition < 5; ++repetition) {
    TileCache cache(field_->file(), 64 << 10);
    for (std::uint64_t k = tiles(); cache.statistics().decoded_bytes < 60 << 10;) {
      ASSERT_GT(k, wanted[1].index);
      ASSERT_TRUE(cache.load(std::vector{key(--k)}));
    }
    TileCache::Reader reader(cache.epochs());
    std::vector<std::thread> threads;
    {
      const TileCache::ReadScope scope(reader);  // what is removed now is not freed
      for (const TileKey at : wanted)
        threads.emplace_back([&cache, at] { EXPECT_TRUE(cache.load(std::vector{at})); });
      std::this_thread::sleep_for(std::chrono::milliseconds(20));  // most often both wait then
    }
    for (std::thread& thread : threads) thread.join();
    EXPECT_LE(cache.statistics().decoded_peak_bytes, 64u << 10);
  }
}

TEST_F(TileCacheTest, ThereIsRoomWhileOlderFramesTilesCanGo) {
  TileCache cache(field_->file(), 64 << 10);
  const std::uint32_t frame = cache.begin_frame();
  EXPECT_TRUE(cache.has_room(frame));
  for (std::uint64_t k = 0; cache.has_room(frame); ++k) {
    ASSERT_LT(k, tiles());
    ASSERT_TRUE(cache.load(std::vector{key(k)}));
  }
  EXPECT_TRUE(cache.has_room(cache.begin_frame()));
}

TEST_F(TileCacheTest, ReadersSeeWholeTilesWhileOthersLoadAndRemove) {
  std::vector<std::vector<std::byte>> expected;
  for (std::uint64_t k = 0; k < tiles(); ++k) expected.push_back(samples(key(k)));
  TileCache cache(field_->file(), 96 << 10);
  std::atomic<int> loading{2};
  std::atomic<std::uint64_t> found{0};
  const auto load = [&](unsigned seed) {
    std::mt19937 random(seed);
    for (int k = 0; k < testing::repetitions(1000); ++k) {
      const auto pins = cache.load(std::vector{key(random() % tiles())});
      EXPECT_TRUE(pins);
    }
    --loading;
  };
  const auto read = [&](unsigned seed) {
    std::mt19937 random(seed);
    TileCache::Reader reader(cache.epochs());
    do {
      const TileCache::ReadScope scope(reader);
      for (int k = 0; k < 64; ++k) {
        const std::uint64_t index = random() % tiles();
        TilePage* page = find(cache, key(index));
        if (!page || !(page->state.load(std::memory_order_acquire) & TilePage::kLoaded)) continue;
        ++found;
        const auto& bytes = expected[index];
        if (page->color.load()) {
          EXPECT_TRUE(std::equal(bytes.begin(), bytes.end(), page->color.load()));
        } else {
          EXPECT_TRUE(bytes.empty());
        }
      }
    } while (loading > 0);
  };
  std::vector<std::thread> threads;
  for (unsigned k = 0; k < 2; ++k) {
    threads.emplace_back(load, k);
    threads.emplace_back(read, 10 + k);
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_GT(found, 0u);
  EXPECT_LE(cache.statistics().decoded_peak_bytes, (96u << 10) + 2 * 16384);
}

/// Tiles that these are predicted from.
std::vector<TileKey> references(const FieldFile& field, std::span<const TileKey> tiles) {
  std::set<TileKey> found;
  for (const TileKey key : tiles)
    if (const auto ref = field.store().find(key)) {
      const auto named = field.references(*ref);
      for (const TileKey reference : *named) found.insert(reference);
    }
  return {found.begin(), found.end()};
}

class TileCachePredicted : public ::testing::Test {
 protected:
  TileCachePredicted() {
    const auto scene = std::move(*make_analytic_scene("balls"));
    BuildOptions options = lossless_options(4, 8, 2);
    options.codec = "predictive:90";
    field_ = build_and_open(*scene, folder_ / "predicted.slf", options);
  }
  [[nodiscard]] const FieldFile& field() const { return field_->file(); }
  [[nodiscard]] bool stored(TileKey key) const {
    return field().store().find(key)->state == storage::TileState::stored;
  }
  [[nodiscard]] std::vector<TileKey> stored_tiles(std::uint64_t from, std::size_t count) const {
    std::vector<TileKey> keys;
    for (; keys.size() < count; ++from)
      if (stored({2, from})) keys.push_back({2, from});
    return keys;
  }
  /// What tiles cost in a cache, with bookkeeping.
  [[nodiscard]] std::uint64_t cost(std::span<const TileKey> keys) const {
    std::uint64_t sum = 0;
    for (const TileKey key : keys) sum += (stored(key) ? field().tile_shape(key).bytes() : 0) + 512;
    return sum;
  }

  const TemporaryFolder folder_;
  std::optional<Field> field_;
};

TEST_F(TileCachePredicted, ABatchDecodesEachReferenceOnceIfEachLevelFitsWithTheNext) {
  const std::vector<TileKey> batch = stored_tiles(tile_count(2, 0) / 3, 24);
  const std::vector<TileKey> coarser = references(field(), batch);
  const std::vector<TileKey> coarsest = references(field(), coarser);
  ASSERT_GT(coarser.size(), 10u);
  ASSERT_GT(coarsest.size(), 5u);
  const std::uint64_t budget = cost(coarser) + std::max(cost(batch), cost(coarsest));
  TileCache cache(field(), budget);
  ASSERT_TRUE(cache.load(batch));
  const auto count = [&](const std::vector<TileKey>& keys) {
    return static_cast<std::uint64_t>(
        std::ranges::count_if(keys, [&](TileKey key) { return stored(key); }));
  };
  EXPECT_EQ(cache.statistics().decodes, count(batch) + count(coarser) + count(coarsest));
  EXPECT_LE(cache.statistics().decoded_peak_bytes, budget);
}

TEST_F(TileCachePredicted, BesideABatchOnlyWhatOneTileNeedsExceedsTheBudget) {
  const std::vector<TileKey> batch = stored_tiles(tile_count(2, 0) / 8, 150);
  std::uint64_t most = 0;  // of a tile and all that is pinned while it is decoded
  for (const TileKey& key : batch) {
    const std::vector<TileKey> coarser = references(field(), {&key, 1});
    most = std::max(most, cost({&key, 1}) + cost(coarser) + cost(references(field(), coarser)));
  }
  TileCache cache(field(), 1);
  ASSERT_TRUE(cache.load(batch));  // all of whose tiles it pins
  EXPECT_LE(cache.statistics().decoded_peak_bytes, cost(batch) + most);
}

}  // namespace
}  // namespace slf
