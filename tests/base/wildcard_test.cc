#include "base/wildcard.h"

#include <fnmatch.h>
#include <gtest/gtest.h>

#include <random>
#include <string>

namespace slf {
namespace {

TEST(Wildcard, FitsWhatFnmatchFits) {
  std::mt19937 random(7);
  const auto text = [&](std::string_view letters, std::size_t most) {
    std::string result;
    for (std::size_t k = random() % (most + 1); k > 0; --k)
      result += letters[random() % letters.size()];
    return result;
  };
  int fitting = 0;
  for (int k = 0; k < 300000; ++k) {
    const std::string pattern = text("abc**??[[]!", 9), name = text("abc!", 7);
    const bool fits = fits_pattern(pattern, name);
    ASSERT_EQ(fits, fnmatch(pattern.c_str(), name.c_str(), 0) == 0) << pattern << " " << name;
    fitting += fits;
  }
  EXPECT_GT(fitting, 10000);
}

TEST(Wildcard, CountsCharactersOfUtf8) {
  EXPECT_TRUE(fits_pattern("K?rper", "Körper"));
  EXPECT_TRUE(fits_pattern("K[o-ü]rper", "Körper"));
  EXPECT_FALSE(fits_pattern("K??rper", "Körper"));
  EXPECT_TRUE(fits_pattern("[a-c]-[!a-c]", "b-d"));
  EXPECT_TRUE(fits_pattern("?", "\xff"));
  EXPECT_TRUE(fits_pattern("\\*[\\]]", "*]"));
  EXPECT_TRUE(fits_pattern("a[", "a["));
  EXPECT_FALSE(fits_pattern("a\\", "a"));
}

TEST(Wildcard, HostilePatternsTakeNoTime) {
  std::string pattern;
  for (int k = 0; k < 200; ++k) pattern += "*a";
  const std::string name(2000, 'a');
  EXPECT_TRUE(fits_pattern(pattern, name));
  EXPECT_FALSE(fits_pattern(pattern + "*b", name));
  EXPECT_FALSE(fits_pattern(pattern + "?*[!a]*", name));
}

}  // namespace
}  // namespace slf
