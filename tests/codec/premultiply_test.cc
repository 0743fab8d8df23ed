#include "codec/premultiply.h"

#include <gtest/gtest.h>

#include <vector>

namespace slf::codec {
namespace {

TEST(Premultiply, IsTheRoundedProductForEveryColorAndAlpha) {
  std::vector<std::uint32_t> pixels;
  std::vector<std::uint8_t> alpha;
  for (std::uint32_t a = 0; a < 256; ++a)
    for (std::uint32_t c = 0; c < 256; ++c) {
      pixels.push_back(c | (255 - c) << 8 | (c ^ 0x55) << 16 | 255u << 24);
      alpha.push_back(static_cast<std::uint8_t>(a));
    }
  const auto opaque = pixels;
  pixels.push_back(0xFF112233), alpha.push_back(0);  // no whole vectors
  premultiply(pixels, alpha);
  const auto scaled = [](std::uint32_t c, std::uint32_t a) { return (2 * c * a + 255) / 510; };
  for (std::size_t k = 0; k < opaque.size(); ++k) {
    const std::uint32_t a = alpha[k], c = opaque[k];
    ASSERT_EQ(pixels[k], scaled(c & 255, a) | scaled(c >> 8 & 255, a) << 8 |
                             scaled(c >> 16 & 255, a) << 16 | a << 24)
        << std::hex << c << " " << a;
  }
  EXPECT_EQ(pixels.back(), 0u);
}

}  // namespace
}  // namespace slf::codec
