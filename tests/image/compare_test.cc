// The measures against closed forms and against the definition, written out without shortcuts.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "slf/image.h"

namespace slf {
namespace {

constexpr double kC1 = 6.5025, kC2 = 58.5225;

Image grey(std::uint32_t width, std::uint32_t height, const std::vector<int>& bytes) {
  Image image{width, height, {}, {}};
  for (const int byte : bytes)
    image.rgba.emplace_back(glm::vec3(static_cast<float>(byte) / 255), 1.0F);
  return image;
}

Image constant(std::uint32_t width, std::uint32_t height, int byte) {
  return grey(width, height, std::vector<int>(std::size_t{width} * height, byte));
}

std::vector<int> noise(std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<int> bytes(count);
  for (int& byte : bytes) byte = static_cast<int>(random() % 256);
  return bytes;
}

TEST(Compare, EqualPicturesAreInfinitelyAlike) {
  const Image image = grey(20, 15, noise(300, 1));
  EXPECT_TRUE(std::isinf(compare(image, image).psnr));
  EXPECT_NEAR(compare(image, image).ssim, 1, 1e-9);
}

TEST(Shrink, TakesMeansOfSquares) {
  Image image{6, 4, std::vector<glm::vec4>(24), std::vector<float>(24, 1.f)};
  for (std::uint32_t k = 0; k < 24; ++k) image.rgba[k] = glm::vec4(k, k / 6, 1, 0);
  const Image small = shrink(image, 2);
  EXPECT_EQ(small.width, 3u);
  EXPECT_EQ(small.height, 2u);
  EXPECT_TRUE(small.depth.empty());
  ASSERT_EQ(small.pixels(), 6u);
  EXPECT_EQ(small.rgba[0], glm::vec4(3.5, 0.5, 1, 0));
  EXPECT_EQ(small.rgba[5], glm::vec4(19.5, 2.5, 1, 0));
  EXPECT_EQ(shrink(image, 1).rgba, image.rgba);
}

TEST(Compare, PsnrOfAConstantError) {
  // 20 log10(255 / 16)
  EXPECT_NEAR(compare(constant(12, 12, 100), constant(12, 12, 116)).psnr, 24.0485, 1e-4);
}

TEST(Compare, PsnrIsOverAllThreeChannelsAndOnBlack) {
  Image a = constant(12, 12, 0), b = a;
  for (auto& pixel : b.rgba) pixel.g = 1;
  EXPECT_NEAR(compare(a, b).psnr, 10 * std::log10(3), 1e-9);
  // Alpha does not count: premultiplied colour is what is seen on black.
  for (auto& pixel : b.rgba) pixel = glm::vec4(0);
  EXPECT_TRUE(std::isinf(compare(a, b).psnr));
}

TEST(Compare, DifferencesBelowEightBitsAreNone) {
  Image a = constant(12, 12, 100), b = a;
  for (auto& pixel : b.rgba) pixel.r += 0.001F;
  EXPECT_TRUE(std::isinf(compare(a, b).psnr));
}

TEST(Compare, SsimOfConstantsIsTheLuminanceTerm) {
  const double expected = (2.0 * 100 * 150 + kC1) / (100.0 * 100 + 150.0 * 150 + kC1);
  EXPECT_NEAR(compare(constant(32, 16, 100), constant(32, 16, 150)).ssim, expected, 1e-9);
}

TEST(Compare, SsimWeighsColoursAsLuma) {
  Image red = constant(16, 16, 0);
  for (auto& pixel : red.rgba) pixel.r = 1;
  const double luma = 0.299 * 255;
  EXPECT_NEAR(compare(red, constant(16, 16, 0)).ssim, kC1 / (luma * luma + kC1), 1e-9);
}

/// Equation 13 at one place, with the 11×11 window as a two-dimensional sum.
double ssim_at(const std::vector<int>& x, const std::vector<int>& y, std::size_t width,
               std::size_t column, std::size_t row) {
  double total = 0, mx = 0, my = 0, vx = 0, vy = 0, vxy = 0;
  const auto sum = [&](auto&& term) {
    for (std::size_t j = 0; j < 11; ++j)
      for (std::size_t i = 0; i < 11; ++i) {
        const double dx = static_cast<double>(i) - 5, dy = static_cast<double>(j) - 5;
        const std::size_t at = (row + j) * width + column + i;
        term(std::exp(-(dx * dx + dy * dy) / 4.5), x[at], y[at]);
      }
  };
  sum([&](double w, int a, int b) { total += w, mx += w * a, my += w * b; });
  mx /= total, my /= total;
  sum([&](double w, int a, int b) {
    vx += w / total * (a - mx) * (a - mx);
    vy += w / total * (b - my) * (b - my);
    vxy += w / total * (a - mx) * (b - my);
  });
  return (2 * mx * my + kC1) * (2 * vxy + kC2) / ((mx * mx + my * my + kC1) * (vx + vy + kC2));
}

TEST(Compare, SsimIsItsDefinition) {
  constexpr std::uint32_t kWidth = 23, kHeight = 17;
  const auto x = noise(kWidth * kHeight, 1);
  auto y = x;
  const auto added = noise(y.size(), 2);
  for (std::size_t i = 0; i < y.size(); ++i) y[i] = std::clamp(y[i] + added[i] / 4 - 32, 0, 255);
  double expected = 0;
  for (std::size_t row = 0; row + 11 <= kHeight; ++row)
    for (std::size_t column = 0; column + 11 <= kWidth; ++column)
      expected += ssim_at(x, y, kWidth, column, row) / ((kWidth - 10) * (kHeight - 10));
  EXPECT_NEAR(compare(grey(kWidth, kHeight, x), grey(kWidth, kHeight, y)).ssim, expected, 1e-7);
}

TEST(Compare, OnlyCountedPixelsCount) {
  constexpr std::uint32_t kWidth = 23, kHeight = 17;
  const auto x = noise(kWidth * kHeight, 1), y = noise(kWidth * kHeight, 2);
  const Image a = grey(kWidth, kHeight, x), b = grey(kWidth, kHeight, y);
  const auto at = [](std::size_t column, std::size_t row) { return row * kWidth + column; };
  // The middle pixels of two windows, and a corner, which is the middle of none.
  std::vector<bool> counted(x.size());
  counted[at(5, 5)] = counted[at(14, 9)] = counted[0] = true;
  double squares = 0;
  for (const std::size_t k : {at(5, 5), at(14, 9), at(0, 0)}) squares += std::pow(x[k] - y[k], 2);
  const ImageDifference found = compare(a, b, counted);
  EXPECT_NEAR(found.psnr, 10 * std::log10(255 * 255 * 3 / squares), 1e-6);
  EXPECT_NEAR(found.ssim, (ssim_at(x, y, kWidth, 0, 0) + ssim_at(x, y, kWidth, 9, 4)) / 2, 1e-7);
  const ImageDifference none = compare(a, b, std::vector<bool>(x.size()));
  EXPECT_EQ(none.psnr, std::numeric_limits<double>::infinity());
  EXPECT_EQ(none.ssim, 1);
}

TEST(Compare, PicturesSmallerThanTheWindowUseASmallerOne) {
  // One pixel: no structure, the luminance term alone.
  EXPECT_NEAR(compare(constant(1, 1, 100), constant(1, 1, 150)).ssim, 0.92310, 1e-4);
  // Two pixels, weights one half each: means 50 and 50, variances 2500, covariance -2500.
  EXPECT_NEAR(compare(grey(2, 1, {0, 100}), grey(2, 1, {100, 0})).ssim,
              (2 * -2500 + kC2) / (2 * 2500 + kC2), 1e-9);
  EXPECT_NEAR(compare(constant(5, 40, 7), constant(5, 40, 7)).ssim, 1, 1e-9);
}

TEST(Difference, IsTheGainedAbsoluteErrorOverBlackAndOpaque) {
  const Image a{1, 1, {glm::vec4(0.5F, 0.2F, 0, 0.5F)}, {}};
  const Image b{1, 1, {glm::vec4(0.25F, 0.3F, 0, 0)}, {}};
  const Image d = difference(a, b, 4);
  EXPECT_NEAR(d.rgba[0].r, 1.0, 1e-6);
  EXPECT_NEAR(d.rgba[0].g, 0.4, 1e-6);
  EXPECT_EQ(d.rgba[0].b, 0);
  EXPECT_EQ(d.rgba[0].a, 1);
}

}  // namespace
}  // namespace slf
