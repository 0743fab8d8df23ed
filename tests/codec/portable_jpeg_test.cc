// The decoder of JPEG scans that WebAssembly uses, beside libjpeg-turbo: the same pixels.
#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "codec/jpeg_decode.h"
#include "codec/jpeg_encode.h"
#include "tests/codec/sample_tiles.h"

// The portable definitions, under names of their own.
#define decode_scan portable_decode_scan
#define standard_tables portable_standard_tables
#include "codec/portable/jpeg_decode.cc"
#undef decode_scan
#undef standard_tables

namespace slf::codec {
namespace {

struct Scan {
  JpegShape shape;
  JpegTables tables;
  Bytes bytes;
  [[nodiscard]] std::size_t pixels() const {
    return std::size_t{shape.width} * shape.height * pixel_bytes(shape.color);
  }
};

// Waves, edges and noise, from calm to wild.
Scan make_scan(std::uint32_t width, std::uint32_t height, JpegColor color, int quality,
               std::uint64_t seed) {
  Random random(seed);
  JpegPicture picture;
  picture.shape = {width, height, color};
  const std::size_t count = std::size_t{width} * height;
  picture.weight.assign(count, 1);
  for (std::size_t plane = 0; plane < (color == JpegColor::gray ? 1u : 3u); ++plane) {
    const double fx = 0.01 + 0.3 * static_cast<double>(random.below(100)) / 100;
    const std::size_t noise = random.below(3) * 100;
    for (std::size_t i = 0; i < count; ++i) {
      const double x = static_cast<double>(i % width), y = static_cast<double>(i / width);
      double value = 128 + 120 * std::sin(fx * x + 0.05 * y * static_cast<double>(plane + 1));
      if (random.below(300) < noise) value = static_cast<double>(random.below(256));
      picture.planes[plane].push_back(static_cast<float>(value));
    }
  }
  Scan scan{picture.shape, standard_tables(quality), {}};
  encode_scan(scan.tables, JpegCoefficients(std::move(picture)), &scan.bytes, nullptr);
  return scan;
}

// The fourth byte of coloured pixels means nothing.
std::vector<std::uint8_t> shown(const Scan& scan, std::vector<std::uint8_t> pixels) {
  if (scan.shape.color != JpegColor::gray)
    for (std::size_t i = 3; i < pixels.size(); i += 4) pixels[i] = 0;
  return pixels;
}

TEST(PortableJpeg, ComputesThePixelsOfLibjpeg) {
  std::uint64_t seed = 0;
  for (const JpegColor color : {JpegColor::gray, JpegColor::ycbcr_444, JpegColor::ycbcr_420})
    for (const int quality : {1, 10, 50, 75, 90, 100})
      for (const auto& [width, height] :
           {std::pair{16u, 16u}, std::pair{32u, 16u}, std::pair{16u, 64u}, std::pair{160u, 112u}}) {
        const Scan scan = make_scan(width, height, color, quality, ++seed);
        std::vector<std::uint8_t> expected(scan.pixels()), found(scan.pixels());
        ASSERT_TRUE(decode_scan(scan.tables, scan.shape, scan.bytes, expected));
        const auto done = portable_decode_scan(scan.tables, scan.shape, scan.bytes, found);
        ASSERT_TRUE(done) << done.error().message;
        ASSERT_EQ(shown(scan, found), shown(scan, expected))
            << width << "x" << height << " quality " << quality << " colour " << int(color);
      }
}

TEST(PortableJpeg, RefusesScansOfAnotherLength) {
  const Scan scan = make_scan(64, 32, JpegColor::ycbcr_420, 75, 1);
  std::vector<std::uint8_t> pixels(scan.pixels());
  for (std::size_t size = 0; size < scan.bytes.size(); ++size)
    EXPECT_FALSE(
        portable_decode_scan(scan.tables, scan.shape, ByteSpan(scan.bytes).first(size), pixels))
        << size;
  Bytes longer = scan.bytes;
  longer.push_back(std::byte{0});
  EXPECT_FALSE(portable_decode_scan(scan.tables, scan.shape, longer, pixels));
}

TEST(PortableJpeg, SurvivesDamage) {
  Random random(3);
  const Scan scan = make_scan(96, 64, JpegColor::ycbcr_420, 80, 2);
  std::vector<std::uint8_t> pixels(scan.pixels());
  for (int trial = 0; trial < 5000; ++trial) {
    Bytes damaged = scan.bytes;
    for (std::size_t k = 0; k <= random.below(4); ++k)
      damaged[random.below(damaged.size())] = static_cast<std::byte>(random.next());
    (void)portable_decode_scan(scan.tables, scan.shape, damaged, pixels);
  }
}

}  // namespace
}  // namespace slf::codec
