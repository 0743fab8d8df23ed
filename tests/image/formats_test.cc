// Decoders of pictures against files that other programs, or an attacker, would write.
#include "image/formats.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfOutputFile.h>
#include <ImfTiledOutputFile.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <half.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <iterator>
#include <random>

namespace slf::image_formats {
namespace {

using Imath::Box2i;
using Imath::V2i;
using ::testing::HasSubstr;

Image noise(std::uint32_t width, std::uint32_t height) {
  std::mt19937 random(1);
  Image image{width, height, {}, {}};
  for (std::uint32_t i = 0; i < width * height; ++i) {
    const auto next = [&] { return static_cast<float>(random() % 256) / 255; };
    image.rgba.emplace_back(next(), next(), next(), 1);
  }
  return image;
}

/// Channels of a value each, over a data window, as another program may write them.
struct ExrSource {
  Imf::Header header;
  std::vector<std::pair<std::string, float>> channels;
  Imf::PixelType type = Imf::HALF;
};

Bytes write_exr(ExrSource source) {
  const Box2i window = source.header.dataWindow();
  const std::size_t width = static_cast<std::size_t>(window.max.x - window.min.x) + 1;
  const std::size_t height = static_cast<std::size_t>(window.max.y - window.min.y) + 1;
  Imf::FrameBuffer buffer;
  std::vector<std::vector<char>> planes;
  for (const auto& [name, value] : source.channels) {
    source.header.channels().insert(name, Imf::Channel(source.type));
    const std::size_t size = source.type == Imf::HALF ? sizeof(half) : sizeof(float);
    auto& plane = planes.emplace_back(width * height * size);
    for (std::size_t i = 0; i < width * height; ++i) {
      const half as_half(value);
      std::memcpy(&plane[i * size],
                  size == sizeof(half) ? static_cast<const void*>(&as_half) : &value, size);
    }
    buffer.insert(name, Imf::Slice::Make(source.type, plane.data(), window, size, size * width));
  }

  const std::string path = ::testing::TempDir() + "/slf-exr-" + std::to_string(::getpid());
  if (source.header.hasTileDescription()) {
    Imf::TiledOutputFile file(path.c_str(), source.header);
    file.setFrameBuffer(buffer);
    file.writeTiles(0, file.numXTiles() - 1, 0, file.numYTiles() - 1);
  } else {
    Imf::OutputFile file(path.c_str(), source.header);
    file.setFrameBuffer(buffer);
    file.writePixels(static_cast<int>(height));
  }
  std::ifstream in(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  std::remove(path.c_str());
  const auto* begin = reinterpret_cast<const std::byte*>(text.data());
  return Bytes(begin, begin + text.size());
}

TEST(DecodeExr, HalfWithoutAlphaIsOpaque) {
  const auto image =
      decode("x", write_exr({Imf::Header(5, 3), {{"R", 0.5F}, {"G", 0.25F}, {"B", 2}}}));
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_EQ(image->width, 5u);
  EXPECT_THAT(image->rgba, ::testing::Each(glm::vec4(0.5F, 0.25F, 2, 1)));
  EXPECT_TRUE(image->depth.empty());
}

TEST(DecodeExr, AbsentColoursAreZeroAndGreyFillsAll) {
  EXPECT_EQ(decode("x", write_exr({Imf::Header(2, 2), {{"G", 0.5F}, {"A", 0.5F}}}))->rgba[3],
            glm::vec4(0, 0.5F, 0, 0.5F));
  EXPECT_EQ(decode("x", write_exr({Imf::Header(2, 2), {{"Y", 0.5F}}}))->rgba[3],
            glm::vec4(0.5F, 0.5F, 0.5F, 1));
}

TEST(DecodeExr, TiledWithDepthReadsLikeScanLines) {
  ExrSource source{Imf::Header(37, 21), {{"R", 1}, {"Z", 7}}, Imf::FLOAT};
  source.header.setTileDescription(Imf::TileDescription(16, 8));
  const auto image = decode("x", write_exr(source));
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_THAT(image->rgba, ::testing::Each(glm::vec4(1, 0, 0, 1)));
  EXPECT_THAT(image->depth, ::testing::Each(7));
}

TEST(DecodeExr, DataOutsideTheDisplayWindowIsCutAndTheRestIsClear) {
  // Data covers the display window's right half, and reaches beyond it.
  const ExrSource source{Imf::Header(Box2i(V2i(-10, 5), V2i(-1, 14)), Box2i(V2i(-5, 5), V2i(9, 9))),
                         {{"R", 1}, {"A", 1}, {"Z", 3}}};
  const auto image = decode("x", write_exr(source));
  ASSERT_TRUE(image) << image.error().message;
  ASSERT_EQ(image->width, 10u);
  ASSERT_EQ(image->height, 10u);
  for (std::size_t y = 0; y < 10; ++y)
    for (std::size_t x = 0; x < 10; ++x) {
      const bool data = x >= 5 && y <= 4;
      EXPECT_EQ(image->rgba[y * 10 + x], data ? glm::vec4(1, 0, 0, 1) : glm::vec4(0)) << x << y;
      EXPECT_EQ(image->depth[y * 10 + x], data ? 3 : std::numeric_limits<float>::infinity());
    }
}

TEST(DecodeExr, HugeWindowsAreRefusedBeforeAnythingIsAllocated) {
  Bytes bytes = encode_exr("x", noise(4, 4)).value();
  const auto at = [&](const char* name) {
    const std::string key = std::string(name) + '\0' + "box2i" + '\0';
    const auto* key_begin = reinterpret_cast<const std::byte*>(key.data());
    const auto found = std::search(bytes.begin(), bytes.end(), key_begin, key_begin + key.size());
    return static_cast<std::size_t>(found - bytes.begin()) + key.size() + 4;
  };
  for (const char* window : {"dataWindow", "displayWindow"}) {
    Bytes hostile = bytes;
    store_le<std::uint32_t>(&hostile[at(window) + 8], 0x0fffffff);
    const auto image = decode("big.exr", hostile);
    ASSERT_FALSE(image);
    EXPECT_THAT(image.error().message, HasSubstr("big.exr: claims 268435456x4 pixels"));
    EXPECT_EQ(image.error().code, ErrorCode::unsupported);
  }
  // A window that is allowed, but for which the file is far too short.
  store_le<std::uint32_t>(&bytes[at("dataWindow") + 12], 32000);
  EXPECT_EQ(decode("x", bytes).error().code, ErrorCode::bad_file);
}

TEST(DecodeExr, AttributesThatClaimMoreThanTheFileAreRefused) {
  Bytes bytes = encode_exr("x", noise(4, 4)).value();
  const std::string key = std::string("channels") + '\0' + "chlist" + '\0';
  const auto* begin = reinterpret_cast<const std::byte*>(key.data());
  const auto found = std::search(bytes.begin(), bytes.end(), begin, begin + key.size());
  store_le<std::uint32_t>(&*found + key.size(), 0x7fffffff);
  const auto image = decode("x", bytes);
  ASSERT_FALSE(image);
  EXPECT_THAT(image.error().message, HasSubstr("ends inside its header"));
}

Bytes bytes_of(std::string_view text) {
  const auto* begin = reinterpret_cast<const std::byte*>(text.data());
  return {begin, begin + text.size()};
}

std::string hdr(const std::string& size, const std::string& pixels) {
  return "#?RADIANCE\n# made by hand\nFORMAT=32-bit_rle_rgbe\n\n" + size + "\n" + pixels;
}

/// Eight pixels (128, 64, 0) with exponents that double, in runs and literally.
const std::string kCodedRow = std::string("\2\2\0\10", 4) + "\x88\x80" + "\x88\x40" +
                              std::string("\x88\0", 2) + "\10\x80\x81\x82\x83\x84\x85\x86\x87";

TEST(DecodeHdr, RunsAndLiteralsAreRadiance) {
  const auto image = decode_hdr("sky", bytes_of(hdr("-Y 2 +X 8", kCodedRow + kCodedRow)));
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_EQ(image->height, 2u);
  for (std::size_t k = 0; k < 16; ++k)
    EXPECT_EQ(image->rgba[k],
              std::ldexp(1.f, static_cast<int>(k % 8)) * glm::vec4(0.5f, 0.25f, 0, 0) +
                  glm::vec4(0, 0, 0, 1));
}

TEST(DecodeHdr, OldRunsRepeatThePixelBefore) {
  const auto image =
      decode_hdr("sky", bytes_of(hdr("-Y 1 +X 4", std::string("\x80\x40\0\x81\1\1\1\3", 8))));
  ASSERT_TRUE(image) << image.error().message;
  for (const glm::vec4& pixel : image->rgba) EXPECT_EQ(pixel, glm::vec4(1, 0.5f, 0, 1));
}

TEST(DecodeHdr, DamageIsNamed) {
  const std::string whole = hdr("-Y 2 +X 8", kCodedRow + kCodedRow);
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_FALSE(decode_hdr("sky", bytes_of(whole.substr(0, size)))) << size;
  const auto message = [](const std::string& size, const std::string& pixels) {
    const auto image = decode_hdr("sky", bytes_of(hdr(size, pixels)));
    return image ? std::string() : image.error().message;
  };
  EXPECT_THAT(message("-Y 2 +X 8", kCodedRow), HasSubstr("row 1 of 2"));
  EXPECT_THAT(message("-Y 1 +X 8", std::string("\2\2\0\10\x89\1", 6)), HasSubstr("row 0"));
  EXPECT_THAT(message("-Y 1 +X 4", std::string("\1\1\1\4", 4)), HasSubstr("row 0"));
  EXPECT_THAT(message("+Y 1 +X 4", ""), HasSubstr("expected \"-Y HEIGHT +X WIDTH\""));
  EXPECT_THAT(message("-Y 0 +X 4", ""), HasSubstr("no pixels"));
  EXPECT_THAT(message("-Y 30000 +X 30000", ""), HasSubstr("claims 30000x30000"));
}

TEST(DecodePng, HugeSizesAreRefused) {
  Bytes bytes = encode_png("x", noise(4, 4), {}).value();
  store_be<std::uint32_t>(&bytes[16], 900000);
  // The header's own checksum is wrong now; either complaint stops it before it allocates.
  EXPECT_FALSE(decode("x", bytes));

  // CRC-32 of "IHDR" and 40000 x 40000, 8-bit RGB.
  store_be<std::uint32_t>(&bytes[16], 40000);
  store_be<std::uint32_t>(&bytes[20], 40000);
  std::uint32_t crc = 0xffffffff;
  for (std::size_t i = 12; i < 29; ++i) {
    crc ^= static_cast<std::uint32_t>(bytes[i]);
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320 : 0);
  }
  store_be<std::uint32_t>(&bytes[29], ~crc);
  const auto image = decode("big.png", bytes);
  ASSERT_FALSE(image);
  EXPECT_EQ(image.error().code, ErrorCode::unsupported) << image.error().message;
  EXPECT_THAT(image.error().message, HasSubstr("big.png: claims 40000x40000 pixels"));
}

TEST(DecodeJpeg, HugeSizesAreRefused) {
  Bytes bytes = encode_jpeg("x", noise(16, 16), {}).value();
  for (std::size_t i = 0; i + 9 < bytes.size(); ++i)
    if (bytes[i] == std::byte{0xff} && bytes[i + 1] == std::byte{0xc0}) {
      store_be<std::uint16_t>(&bytes[i + 5], 65000);
      store_be<std::uint16_t>(&bytes[i + 7], 65000);
      break;
    }
  const auto image = decode("big.jpg", bytes);
  ASSERT_FALSE(image);
  EXPECT_EQ(image.error().code, ErrorCode::unsupported);
  EXPECT_THAT(image.error().message, HasSubstr("big.jpg: claims 65000x65000 pixels"));
}

TEST(EncodeJpeg, SidesTheFormatCannotHoldAreAnError) {
  const Image image{70000, 1, std::vector<glm::vec4>(70000), {}};
  const auto bytes = encode_jpeg("wide.jpg", image, {});
  ASSERT_FALSE(bytes);
  EXPECT_EQ(bytes.error().code, ErrorCode::failed);
  EXPECT_THAT(bytes.error().message, HasSubstr("wide.jpg: cannot encode as JPEG: "));
}

TEST(Decode, FlippedBitsNeverCrashAndNeverChangeTheSizeUnnoticed) {
  Image source = noise(24, 17);
  source.depth.assign(source.pixels(), 1);
  const std::vector<Bytes> files = {encode_png("x", source, {}).value(),
                                    encode_jpeg("x", source, {}).value(),
                                    encode_exr("x", source).value()};
  std::mt19937 random(7);
  for (const Bytes& file : files)
    for (int round = 0; round < 1500; ++round) {
      Bytes damaged = file;
      // Half of the flips hit the first kilobyte, where the headers are.
      const std::size_t range =
          round % 2 == 0 ? std::min<std::size_t>(1024, file.size()) : file.size();
      damaged[random() % range] ^= std::byte(1 << random() % 8);
      const auto image = decode("x", damaged);
      if (image) {
        ASSERT_EQ(image->rgba.size(), std::size_t{image->width} * image->height);
      } else {
        ASSERT_THAT(image.error().message, HasSubstr("x: "));
      }
    }
}

}  // namespace
}  // namespace slf::image_formats
