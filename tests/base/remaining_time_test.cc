#include "base/remaining_time.h"

#include <gtest/gtest.h>

namespace slf {
namespace {

TEST(RemainingTime, DoesNotCountWhatCameBeforeTheWork) {
  // A build whose light takes as long as its rays, of which a third exist already: 60 s and 60 s.
  RemainingTime left;
  for (const double now : {0.0, 20.0, 60.0}) EXPECT_FALSE(left({300, 900, 300}, now));
  for (int s = 5; s <= 60; s += 5) {
    const auto seconds = left({300 + 10 * static_cast<std::uint64_t>(s), 900, 300}, 60.0 + s);
    ASSERT_TRUE(seconds);
    EXPECT_NEAR(*seconds, 60 - s, 1e-9);
  }
}

TEST(RemainingTime, IsUnknownBeforeAnyWork) {
  RemainingTime left;
  EXPECT_FALSE(left({0, 10, 0}, 3));
  EXPECT_EQ(left.rate({0, 10, 0}, 4), 0);
  EXPECT_EQ(*left({10, 10, 0}, 5), 0);
}

}  // namespace
}  // namespace slf
