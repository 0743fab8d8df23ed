#include "storage/internal/range_set.h"

#include <gtest/gtest.h>

#include <bitset>
#include <random>

namespace slf::storage::internal {
namespace {

constexpr std::size_t kBytes = 64;

TEST(RangeSet, AgreesWithASetOfBytes) {
  std::mt19937 random(7);
  for (int round = 0; round < 200; ++round) {
    RangeSet set;
    std::bitset<kBytes> bytes;
    for (int step = 0; step < 12; ++step) {
      const std::uint64_t begin = random() % kBytes,
                          end = begin + random() % (kBytes - begin + 1) / 4;
      for (std::uint64_t i = begin; i < end; ++i) bytes[i] = true;
      set.add({begin, end});

      const std::uint64_t from = random() % kBytes, to = from + random() % (kBytes - from + 1);
      std::vector<FileRange> lacks;
      set.append_missing({from, to}, lacks);
      std::bitset<kBytes> absent, expected;
      for (std::size_t k = 0; k < lacks.size(); ++k) {
        ASSERT_LT(lacks[k].begin, lacks[k].end);
        if (k > 0) {
          ASSERT_GT(lacks[k].begin, lacks[k - 1].end);
        }
        for (std::uint64_t i = lacks[k].begin; i < lacks[k].end; ++i) absent[i] = true;
      }
      bool any = false;
      for (std::uint64_t i = from; i < to; ++i) {
        expected[i] = !bytes[i];
        any |= bytes[i];
      }
      ASSERT_EQ(absent, expected);
      ASSERT_EQ(set.contains({from, to}), expected.none());
      ASSERT_EQ(set.intersects({from, to}), any);
    }
  }
}

bool equal(const std::vector<FileRange>& a, const std::vector<FileRange>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](FileRange x, FileRange y) { return x.begin == y.begin && x.end == y.end; });
}

TEST(RangeSet, MergesUntilThereAreFewRanges) {
  const std::vector<FileRange> ranges{{50, 60}, {0, 10}, {12, 20}, {30, 35}, {70, 71}};
  EXPECT_TRUE(equal(merged(ranges, 0, 9), {{0, 10}, {12, 20}, {30, 35}, {50, 60}, {70, 71}}));
  EXPECT_TRUE(equal(merged(ranges, 2, 9), {{0, 20}, {30, 35}, {50, 60}, {70, 71}}));
  EXPECT_TRUE(equal(merged(ranges, 0, 2), {{0, 35}, {50, 71}}));
  EXPECT_TRUE(equal(merged(ranges, 0, 1), {{0, 71}}));
  EXPECT_TRUE(equal(merged(ranges, 0, 1, 9), {{0, 20}, {30, 35}, {50, 60}, {70, 71}}));
  EXPECT_TRUE(merged({}, 5, 1).empty());
}

}  // namespace
}  // namespace slf::storage::internal
