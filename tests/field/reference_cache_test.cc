// ReferenceCache: tiles that others are predicted from.

#include "field/reference_cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <new>
#include <thread>
#include <vector>

namespace slf {
namespace {

const TileKey kKey{0, 7};

// No memory is not an error of the tile: readers must not take the tile for missing.
TEST(ReferenceCache, ExceptionsOfLoadArePassedOnAndNotCached) {
  bool fails = true;
  ReferenceCache cache([&](TileKey) -> Result<TileSamples> {
    if (fails) throw std::bad_alloc();
    return std::make_shared<const Bytes>(5);
  });
  EXPECT_THROW((void)cache.get(kKey), std::bad_alloc);
  EXPECT_FALSE(cache.has(kKey));
  fails = false;
  const auto samples = cache.get(kKey);
  ASSERT_TRUE(samples);
  EXPECT_EQ((*samples)->size(), 5u);
}

TEST(ReferenceCache, ThreadsThatWaitForATileGoOnAfterAnException) {
  std::atomic<int> loads{0}, thrown{0};
  ReferenceCache cache([&](TileKey) -> Result<TileSamples> {
    if (++loads < 4) throw std::bad_alloc();
    return std::make_shared<const Bytes>(5);
  });
  std::vector<std::jthread> threads;
  for (int k = 0; k < 8; ++k)
    threads.emplace_back([&] {
      try {
        EXPECT_TRUE(cache.get(kKey));
      } catch (const std::bad_alloc&) {
        ++thrown;
      }
    });
  threads.clear();
  EXPECT_EQ(thrown, 3);
  EXPECT_EQ(loads, 4);
}

}  // namespace
}  // namespace slf
