// Cold files: what is asked for together is fetched together.
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/resource.h>

#include "tests/storage/storage_testing.h"

namespace slf::storage::testing {
namespace {

constexpr std::uint64_t kStoredTiles = 4000;
constexpr std::uint64_t kStep = 20;  // of tiles read: each in a record of its own, or nearly so

// Faults of this process that had to wait for a disk because nobody had asked for the page.
long faults() {
  rusage usage = {};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_majflt;
}

class ColdFile : public ::testing::Test {
 protected:
  void SetUp() override {
    TileWriter writer = create(path_);
    for (std::uint64_t i = 0; i < kStoredTiles; ++i)
      ASSERT_TRUE(ok(writer.append({2, i}, tile_bytes({2, i}, 4000))));
    ASSERT_TRUE(ok(writer.close()));
    for (std::uint64_t i = 0; i < kStoredTiles; i += kStep)
      keys_.push_back({2, (i * 7) % kStoredTiles});
  }
  void TearDown() override { std::filesystem::remove(path_); }

  // Writes the file to the disk and forgets it. False where the file system has no disk.
  [[nodiscard]] bool chill() const {
    const int file = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC);
    const std::size_t bytes = std::filesystem::file_size(path_);
    (void)fsync(file);
    (void)posix_fadvise(file, 0, 0, POSIX_FADV_DONTNEED);
    void* map = mmap(nullptr, bytes, PROT_READ, MAP_SHARED, file, 0);
    std::vector<unsigned char> resident((bytes + 4095) / 4096);
    const bool known = mincore(map, bytes, resident.data()) == 0;
    munmap(map, bytes);
    ::close(file);
    return known && std::ranges::none_of(resident, [](unsigned char page) { return page & 1; });
  }

  // In the folder of the tests, which is rather on a disk than those in memory.
  const std::string path_ = "cold-" + std::to_string(getpid()) + ".slf";
  std::vector<TileKey> keys_;
};

TEST_F(ColdFile, IsFoundAndReadWithHardlyAFault) {
  if (!chill()) GTEST_SKIP() << "this file system keeps files in memory";
  auto store = TileStore::open(path_);
  ASSERT_TRUE(ok(store));
  const long before = faults();
  std::vector<TileRef> tiles;
  for (auto& found : store->find_all(keys_)) {
    ASSERT_TRUE(ok(found));
    tiles.push_back(*found);
  }
  store->advise(tiles);
  for (const TileRef& tile : tiles) EXPECT_TRUE(ok(store->check(tile)));
  EXPECT_LT(faults() - before, static_cast<long>(keys_.size() / 4));
}

TEST_F(ColdFile, IsVisitedWithHardlyAFault) {
  if (!chill()) GTEST_SKIP() << "this file system keeps files in memory";
  auto store = TileStore::open(path_);
  ASSERT_TRUE(ok(store));
  const long before = faults();
  const auto found = store->statistics({{2, 0}, {3, 0}});
  ASSERT_TRUE(ok(found));
  EXPECT_LT(faults() - before, static_cast<long>(found->records / 4));
}

}  // namespace
}  // namespace slf::storage::testing
