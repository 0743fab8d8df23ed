#include "codec/mosaic.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <vector>

namespace slf::codec {
namespace {

// The pixel of a sample; -1 beyond the rectangle.
std::ptrdiff_t pixel(const Mosaic& mosaic, std::size_t row, std::uint32_t p, std::uint32_t q) {
  const MosaicLine line = mosaic.line(row, q);
  const auto at = static_cast<std::ptrdiff_t>(line.start) + line.step * p;
  return at < static_cast<std::ptrdiff_t>(mosaic.pixels()) ? at : -1;
}

RC_GTEST_PROP(Mosaic, GivesEverySampleAPixelOfItsOwn, ()) {
  const std::size_t rows = *rc::gen::inRange<std::size_t>(1, 60);
  const std::uint32_t side = *rc::gen::inRange<std::uint32_t>(0, 40);
  const std::uint32_t align = *rc::gen::element<std::uint32_t>(1, 8, 16);
  const Mosaic mosaic(rows, side, align);
  RC_ASSERT(mosaic.width() % align == 0u);
  RC_ASSERT(mosaic.height() % align == 0u);
  std::vector<bool> taken(mosaic.pixels());
  for (std::size_t row = 0; row < rows; ++row)
    for (std::uint32_t q = 0; q <= side; ++q)
      for (std::uint32_t p = 0; p <= side - q; ++p) {
        const std::ptrdiff_t at = pixel(mosaic, row, p, q);
        RC_ASSERT(at >= 0);
        RC_ASSERT(!taken[static_cast<std::size_t>(at)]);
        taken[static_cast<std::size_t>(at)] = true;
      }
}

RC_GTEST_PROP(Mosaic, KeepsNeighboursOfAPictureNeighbours, ()) {
  const std::size_t rows = *rc::gen::inRange<std::size_t>(1, 60);
  const std::uint32_t side = *rc::gen::inRange<std::uint32_t>(1, 40);
  const Mosaic mosaic(rows, side, 8);
  const std::size_t row = *rc::gen::inRange<std::size_t>(0, rows);
  const std::uint32_t q = *rc::gen::inRange<std::uint32_t>(0, side);
  const std::uint32_t p = *rc::gen::inRange<std::uint32_t>(0, side - q);
  const auto width = static_cast<std::ptrdiff_t>(mosaic.width());
  const auto here = pixel(mosaic, row, p, q);
  const auto distance = [&](std::ptrdiff_t there) {
    return std::abs(here / width - there / width) + std::abs(here % width - there % width);
  };
  RC_ASSERT(distance(pixel(mosaic, row, p + 1, q)) == 1);
  RC_ASSERT(distance(pixel(mosaic, row, p, q + 1)) == 1);
}

TEST(Mosaic, PutsThePairFaceToFaceAcrossTheDiagonal) {
  const std::uint32_t side = 5;
  const Mosaic mosaic(2, side, 1);
  ASSERT_EQ(mosaic.width(), side + 1);
  ASSERT_EQ(mosaic.height(), side + 2);
  for (std::uint32_t p = 0; p <= side; ++p) {
    const std::uint32_t q = side - p;
    EXPECT_EQ(pixel(mosaic, 0, p, q), static_cast<std::ptrdiff_t>(q * mosaic.width() + p));
    // The second picture's sample at the same place lies right below.
    EXPECT_EQ(pixel(mosaic, 1, p, q), pixel(mosaic, 0, p, q) + 6);
  }
}

TEST(Mosaic, OfNoPicturesHasNoPixels) {
  const Mosaic mosaic(0, 4, 8);
  EXPECT_EQ(mosaic.width(), 0u);
  EXPECT_EQ(mosaic.pixels(), 0u);
}

TEST(Mosaic, WastesLittleOnTheUsualTile) {
  const Mosaic mosaic(45, 32, 16);
  EXPECT_LT(static_cast<double>(mosaic.pixels()), 1.2 * 45 * 561);
}

}  // namespace
}  // namespace slf::codec
