#include "codec/color_kernel.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>
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

TEST(AddDifferences, IsTheMatrixTimesTheDifferencesWithinAlpha) {
  std::mt19937 random(1);
  for (const ColorMatrix& matrix :
       {kYcbcr, ColorMatrix{239, -335, 148, 262, 26, -350, 265, 277, 212},
        ColorMatrix{1024, -1024, 1024, -1024, 1024, 1024, 1024, 1024, -1024}}) {
    std::array<std::vector<std::int16_t>, 3> planes;
    std::vector<std::uint32_t> before;
    for (int k = 0; k < 1003; ++k) {
      const auto alpha = static_cast<std::uint32_t>(random() % 256);
      std::uint32_t rgba = alpha << 24;
      for (int c = 0; c < 24; c += 8)
        rgba |= static_cast<std::uint32_t>(random()) % (alpha + 1) << c;
      before.push_back(rgba);
      for (auto& plane : planes)
        plane.push_back(static_cast<std::int16_t>(static_cast<int>(random() % 65536) - 32768) >>
                        (k % 2 == 0 ? 0 : 8));
    }
    slf::testing::with_each_instruction_set([&](const char* set) {
      auto pixels = before;
      add_differences({planes[0], planes[1], planes[2]}, matrix, pixels);
      for (std::size_t k = 0; k < pixels.size(); ++k) {
        const int alpha = static_cast<int>(before[k] >> 24);
        ASSERT_EQ(pixels[k] >> 24, before[k] >> 24);
        for (std::size_t c = 0; c < 3; ++c) {
          const int sum = matrix[3 * c] * planes[0][k] + matrix[3 * c + 1] * planes[1][k] +
                          matrix[3 * c + 2] * planes[2][k] + (c == 1 ? 127 : 128);
          const int value = static_cast<int>(before[k] >> 8 * c & 255) + (sum >> 8);
          ASSERT_EQ(static_cast<int>(pixels[k] >> 8 * c & 255), std::clamp(value, 0, alpha))
              << set << " " << k << " " << c;
        }
      }
    });
  }
}

/// As tables of version 2 define it, with two roundings.
TEST(AddDifferences, OfYcbcrIsAsEver) {
  for (int cb = -300; cb <= 300; cb += 7)
    for (int cr = -300; cr <= 300; ++cr)
      for (const int y : {-40, 0, 31}) {
        const std::vector<std::int16_t> planes[] = {{static_cast<std::int16_t>(y)},
                                                    {static_cast<std::int16_t>(cb)},
                                                    {static_cast<std::int16_t>(cr)}};
        std::vector<std::uint32_t> pixel{0xFF808080u};
        add_differences({planes[0], planes[1], planes[2]}, kYcbcr, pixel);
        const auto limit = [](int v) { return static_cast<std::uint32_t>(std::clamp(v, 0, 255)); };
        const std::uint32_t r = limit(128 + y + ((359 * cr + 128) >> 8)),
                            g = limit(128 + y - ((88 * cb + 183 * cr + 128) >> 8)),
                            b = limit(128 + y + ((454 * cb + 128) >> 8));
        ASSERT_EQ(pixel[0], 0xFF000000u | r | g << 8 | b << 16) << y << " " << cb << " " << cr;
      }
}

}  // namespace
}  // namespace slf::codec
