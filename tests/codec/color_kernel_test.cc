#include "codec/color_kernel.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/instruction_set.h"

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
  pixels.push_back(0xFF112233), alpha.push_back(0);  // no whole vectors
  const auto opaque = pixels;
  const auto scaled = [](std::uint32_t c, std::uint32_t a) { return (2 * c * a + 255) / 510; };
  slf::testing::with_each_instruction_set([&](const char* set) {
    pixels = opaque;
    premultiply(pixels, alpha);
    for (std::size_t k = 0; k < opaque.size(); ++k) {
      const std::uint32_t a = alpha[k], c = opaque[k];
      ASSERT_EQ(pixels[k], scaled(c & 255, a) | scaled(c >> 8 & 255, a) << 8 |
                               scaled(c >> 16 & 255, a) << 16 | a << 24)
          << set << std::hex << " " << c << " " << a;
    }
  });
}

}  // namespace
}  // namespace slf::codec
