#include "page/ranges.h"

#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

namespace slf::page {
namespace {

using Parts = std::vector<std::pair<std::uint64_t, std::uint64_t>>;  // first byte and size

/// The parts of a file of 100 bytes.
Parts parts_of(const std::string& header) {
  Parts parts;
  const auto selected = select_ranges(header, 100);
  EXPECT_TRUE(selected) << header;
  if (selected)
    for (const FilePart& part : *selected) parts.emplace_back(part.first, part.size);
  return parts;
}

TEST(Ranges, SelectTheBytesThatTheyName) {
  EXPECT_EQ(parts_of("bytes=0-0"), (Parts{{0, 1}}));
  EXPECT_EQ(parts_of("bytes=10-19"), (Parts{{10, 10}}));
  EXPECT_EQ(parts_of("bytes=90-"), (Parts{{90, 10}}));
  EXPECT_EQ(parts_of("bytes=-7"), (Parts{{93, 7}}));
  EXPECT_EQ(parts_of("bytes=-500"), (Parts{{0, 100}}));
  EXPECT_EQ(parts_of("bytes=98-200"), (Parts{{98, 2}}));
  EXPECT_EQ(parts_of("bytes=5-9, 0-1,99-99"), (Parts{{5, 5}, {0, 2}, {99, 1}}));
}

TEST(Ranges, BehindTheEndSelectNothing) {
  EXPECT_EQ(parts_of("bytes=100-"), Parts{});
  EXPECT_EQ(parts_of("bytes=-0"), Parts{});
  EXPECT_EQ(parts_of("bytes=100-200,3-4"), (Parts{{3, 2}}));
}

TEST(Ranges, ThatAreMalformedOrTooMuchSelectTheWholeFile) {
  for (const char* header :
       {"", "bytes", "bytes=", "bytes=-", "bytes=9-8", "bytes=a-1", "bytes=1-2-3", "bytes=1-2,",
        "lines=1-2", "bytes=0-99,0-0", "bytes=0-60,40-99"})
    EXPECT_FALSE(select_ranges(header, 100)) << header;
  std::string many = "bytes=1-1";
  for (std::size_t count = 1; count < kMaxRanges; ++count) many += ",1-1";
  EXPECT_TRUE(select_ranges(many, 1000));
  EXPECT_FALSE(select_ranges(many + ",1-1", 1000));
}

}  // namespace
}  // namespace slf::page
