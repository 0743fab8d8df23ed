// TIFF pictures as other programs write them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tiffio.h>

#include <cstring>
#include <random>

#include "base/file.h"
#include "image/formats.h"
#include "tests/temporary_folder.h"

namespace slf::image_formats {
namespace {

using ::testing::HasSubstr;

constexpr std::uint32_t kWidth = 37, kHeight = 21;

struct Tiff {
  int bits = 8;
  int samples = 3;
  int kind = PHOTOMETRIC_RGB;
  int compression = COMPRESSION_NONE;
  int extra = -1;  ///< meaning of the last sample; -1: not stated
  bool planes = false;
  bool tiles = false;
  int format = SAMPLEFORMAT_UINT;
  const char* mode = "w";
  bool thumbnail = false;  ///< comes first, marked as one
  std::uint32_t width = kWidth;
};

/// A smooth ramp in each sample, 0 to 1.
double ramp(std::uint32_t x, std::uint32_t y, int sample) {
  return std::fmod((x + 2.0 * y) / 80 + 0.2 * sample, 1.0);
}

class DecodeTiff : public ::testing::Test {
 protected:
  Bytes bytes_of(const Tiff& t) const {
    const std::string path = folder_ / "a.tif";
    TIFF* tiff = TIFFOpen(path.c_str(), t.mode);
    if (t.thumbnail) write_page(tiff, {.width = 5}, FILETYPE_REDUCEDIMAGE);
    write_page(tiff, t, 0);
    TIFFClose(tiff);
    return read_file(path, 1 << 26).value();
  }

  static void write_page(TIFF* tiff, const Tiff& t, int subfile) {
    TIFFSetField(tiff, TIFFTAG_SUBFILETYPE, subfile);
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, t.width);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, kHeight);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, t.bits);
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, t.format);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, t.samples);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, t.kind);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, t.compression);
    TIFFSetField(tiff, TIFFTAG_PLANARCONFIG,
                 t.planes ? PLANARCONFIG_SEPARATE : PLANARCONFIG_CONTIG);
    if (t.compression == COMPRESSION_JPEG)
      TIFFSetField(tiff, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
    if (t.kind == PHOTOMETRIC_PALETTE) {
      const std::vector<std::uint16_t> map(256, 7);
      TIFFSetField(tiff, TIFFTAG_COLORMAP, map.data(), map.data(), map.data());
    }
    if (t.extra >= 0) {
      const auto meaning = static_cast<std::uint16_t>(t.extra);
      TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, 1, &meaning);
    }
    if (t.tiles) {
      TIFFSetField(tiff, TIFFTAG_TILEWIDTH, 16);
      TIFFSetField(tiff, TIFFTAG_TILELENGTH, 16);
    } else {
      TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 16);
    }
    const auto samples_of = [&](std::uint32_t x, std::uint32_t y, int first, int count,
                                std::string& to) {
      for (int s = first; s < first + count; ++s) {
        const double value = ramp(x, y, s);
        if (t.bits == 8) {
          to += static_cast<char>(std::lround(255 * value));
        } else if (t.bits == 16) {
          const auto wide = static_cast<std::uint16_t>(std::lround(65535 * value));
          to.append(reinterpret_cast<const char*>(&wide), 2);
        } else {
          const auto real = static_cast<float>(value);
          to.append(reinterpret_cast<const char*>(&real), 4);
        }
      }
    };
    for (int plane = 0; plane < (t.planes ? t.samples : 1); ++plane) {
      const int count = t.planes ? 1 : t.samples;
      if (!t.tiles) {
        for (std::uint32_t y = 0; y < kHeight; ++y) {
          std::string row;
          for (std::uint32_t x = 0; x < t.width; ++x) samples_of(x, y, plane, count, row);
          TIFFWriteScanline(tiff, row.data(), y, static_cast<std::uint16_t>(plane));
        }
        continue;
      }
      for (std::uint32_t y0 = 0; y0 < kHeight; y0 += 16)
        for (std::uint32_t x0 = 0; x0 < t.width; x0 += 16) {
          std::string tile;
          for (std::uint32_t y = y0; y < y0 + 16; ++y)
            for (std::uint32_t x = x0; x < x0 + 16; ++x) samples_of(x, y, plane, count, tile);
          TIFFWriteTile(tiff, tile.data(), x0, y0, 0, static_cast<std::uint16_t>(plane));
        }
    }
    TIFFWriteDirectory(tiff);
  }

  /// `expected` is that of a pixel, from its ramps.
  template <class Expected>
  void check(const Tiff& t, double tolerance, const Expected& expected) const {
    const auto image = decode("a.tif", bytes_of(t));
    ASSERT_TRUE(image) << image.error().message;
    ASSERT_EQ(image->width, kWidth);
    ASSERT_EQ(image->height, kHeight);
    for (std::uint32_t y = 0; y < kHeight; ++y)
      for (std::uint32_t x = 0; x < kWidth; ++x) {
        const glm::vec4 want = expected([&](int s) { return static_cast<float>(ramp(x, y, s)); });
        for (int c = 0; c < 4; ++c)
          ASSERT_NEAR(image->rgba[y * kWidth + x][c], want[c], tolerance)
              << x << ',' << y << " channel " << c;
      }
  }
  std::string refusal(const Tiff& t, ErrorCode code) const {
    const auto image = decode("a.tif", bytes_of(t));
    if (image) return "no error";
    EXPECT_EQ(image.error().code, code);
    return image.error().message;
  }

  testing::TemporaryFolder folder_;
};

const auto kRgb = [](const auto& s) { return glm::vec4(s(0), s(1), s(2), 1); };

TEST_F(DecodeTiff, OfEightAndSixteenBitsInAnyLayout) {
  for (const int bits : {8, 16})
    for (const bool planes : {false, true})
      for (const bool tiles : {false, true})
        for (const int compression : {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE})
          check({.bits = bits, .compression = compression, .planes = planes, .tiles = tiles},
                bits == 8 ? 0.002 : 1e-5, kRgb);
  check({.bits = 16, .mode = "wb"}, 1e-5, kRgb);
  check({.mode = "w8"}, 0.002, kRgb);
  check({.thumbnail = true}, 0.002, kRgb);
}

TEST_F(DecodeTiff, OfJpegIsRgb) {
  const auto image =
      decode("a.tif", bytes_of({.kind = PHOTOMETRIC_YCBCR, .compression = COMPRESSION_JPEG}));
  ASSERT_TRUE(image) << image.error().message;
  const glm::vec4 middle = image->rgba[10 * kWidth + 12];
  EXPECT_NEAR(middle.r, ramp(12, 10, 0), 0.08);
  EXPECT_NEAR(middle.b, ramp(12, 10, 2), 0.08);
}

TEST_F(DecodeTiff, GreyFillsAllColoursAndZeroMayBeWhite) {
  check({.samples = 1, .kind = PHOTOMETRIC_MINISBLACK}, 0.002,
        [](const auto& s) { return glm::vec4(glm::vec3(s(0)), 1); });
  check({.samples = 1, .kind = PHOTOMETRIC_MINISWHITE}, 0.002,
        [](const auto& s) { return glm::vec4(glm::vec3(1 - s(0)), 1); });
  check({.bits = 16, .samples = 2, .kind = PHOTOMETRIC_MINISBLACK, .extra = EXTRASAMPLE_UNASSALPHA},
        3e-5, [](const auto& s) { return glm::vec4(glm::vec3(s(0) * s(1)), s(1)); });
}

TEST_F(DecodeTiff, AlphaIsWhatItsTagSays) {
  check({.samples = 4, .extra = EXTRASAMPLE_UNASSALPHA}, 0.005,
        [](const auto& s) { return glm::vec4(glm::vec3(s(0), s(1), s(2)) * s(3), s(3)); });
  check({.samples = 4, .extra = EXTRASAMPLE_UNASSALPHA, .planes = true}, 0.005,
        [](const auto& s) { return glm::vec4(glm::vec3(s(0), s(1), s(2)) * s(3), s(3)); });
  check({.samples = 4, .extra = EXTRASAMPLE_ASSOCALPHA}, 0.002,
        [](const auto& s) { return glm::vec4(s(0), s(1), s(2), s(3)); });
  check({.samples = 4, .extra = EXTRASAMPLE_UNSPECIFIED}, 0.002, kRgb);
}

TEST_F(DecodeTiff, WhatIsNotReadIsNamed) {
  EXPECT_THAT(refusal({.bits = 32, .format = SAMPLEFORMAT_IEEEFP}, ErrorCode::unsupported),
              HasSubstr("a.tif: TIFF with samples of 32 bits"));
  EXPECT_THAT(refusal({.bits = 16, .format = SAMPLEFORMAT_INT}, ErrorCode::unsupported),
              HasSubstr("16 bits, format 2"));
  EXPECT_THAT(refusal({.samples = 1, .kind = PHOTOMETRIC_PALETTE}, ErrorCode::unsupported),
              HasSubstr("colours of kind 3"));
  EXPECT_THAT(refusal({.samples = 4, .kind = PHOTOMETRIC_SEPARATED}, ErrorCode::unsupported),
              HasSubstr("colours of kind 5"));
  EXPECT_THAT(refusal({.samples = 1}, ErrorCode::bad_file), HasSubstr("1 samples"));
}

TEST_F(DecodeTiff, HugeSizesAreRefused) {
  // The width is the second entry of the directory, which libtiff sorts by number.
  Bytes bytes = bytes_of({});
  const std::size_t directory = load_le<std::uint32_t>(&bytes[4]);
  ASSERT_EQ(load_le<std::uint16_t>(&bytes[directory + 2 + 12]), TIFFTAG_IMAGEWIDTH);
  store_le<std::uint16_t>(&bytes[directory + 2 + 12 + 2], TIFF_LONG);
  store_le<std::uint32_t>(&bytes[directory + 2 + 12 + 8], 4000000);
  const auto image = decode("big.tif", bytes);
  ASSERT_FALSE(image);
  EXPECT_EQ(image.error().code, ErrorCode::unsupported);
  EXPECT_THAT(image.error().message, HasSubstr("big.tif: claims 4000000x21 pixels"));
}

TEST_F(DecodeTiff, TruncationAndFlippedBitsNeverCrash) {
  std::mt19937 random(7);
  for (const Tiff& t : {Tiff{}, Tiff{.bits = 16, .samples = 4, .extra = 2, .planes = true},
                        Tiff{.compression = COMPRESSION_LZW, .tiles = true},
                        Tiff{.kind = PHOTOMETRIC_YCBCR, .compression = COMPRESSION_JPEG}}) {
    const Bytes file = bytes_of(t);
    for (std::size_t length = 0; length < file.size(); length += 7) {
      const auto image = decode("x", Bytes(file.begin(), file.begin() + std::ptrdiff_t(length)));
      if (!image) {
        ASSERT_THAT(image.error().message, HasSubstr("x: "));
      }
    }
    for (int round = 0; round < 700; ++round) {
      Bytes damaged = file;
      // The directory, which says most, is at the end.
      const std::size_t range = std::min<std::size_t>(round % 2 == 0 ? 300 : 1 << 20, file.size());
      damaged[file.size() - 1 - random() % range] ^= std::byte(1 << random() % 8);
      const auto image = decode("x", damaged);
      if (image) {
        ASSERT_EQ(image->rgba.size(), std::size_t{image->width} * image->height);
      } else {
        ASSERT_THAT(image.error().message, HasSubstr("x: "));
      }
    }
  }
}

TEST_F(DecodeTiff, SizesComeFromTheHeader) {
  ASSERT_TRUE(write_file(folder_ / "b.tif", bytes_of({.thumbnail = true})));
  const auto size = read_image_size(folder_ / "b.tif");
  ASSERT_TRUE(size) << size.error().message;
  EXPECT_EQ(*size, (ImageSize{kWidth, kHeight}));
}

}  // namespace
}  // namespace slf::image_formats
