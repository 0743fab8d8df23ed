// DICOM series whose pixels are compressed, by GDCM's own writer, against the same ones plain; and
// what damage to them does: an error, never the end of the process.
#include <gdcmImageChangeTransferSyntax.h>
#include <gdcmImageReader.h>
#include <gdcmImageWriter.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>

#include "slf/volume.h"
#include "source/volume/dicom/dicom.h"
#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr std::array kLossless = {
    gdcm::TransferSyntax::RLELossless, gdcm::TransferSyntax::JPEGLosslessProcess14_1,
    gdcm::TransferSyntax::JPEGLSLossless, gdcm::TransferSyntax::JPEG2000Lossless};

std::string content(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// Rewrites a plain DICOM file in another transfer syntax.
void compress(const std::string& path, gdcm::TransferSyntax::TSType syntax) {
  gdcm::ImageReader reader;
  reader.SetFileName(path.c_str());
  ASSERT_TRUE(reader.Read());
  gdcm::ImageChangeTransferSyntax change;
  change.SetTransferSyntax(syntax);
  change.SetInput(reader.GetImage());
  ASSERT_TRUE(change.Change());
  gdcm::ImageWriter writer;
  writer.SetFile(reader.GetFile());
  writer.SetImage(change.GetOutput());
  writer.GetFile().GetHeader().Clear();
  writer.GetFile().GetHeader().SetDataSetTransferSyntax(syntax);
  writer.SetFileName(path.c_str());
  ASSERT_TRUE(writer.Write());
}

/// `bytes` of a file with a 2-byte value of its data set replaced.
std::string with_us(std::string bytes, std::uint16_t group, std::uint16_t element, int value) {
  const auto le = [](unsigned v) { return std::string{char(v & 255), char(v >> 8)}; };
  const auto at = bytes.rfind(le(group) + le(element) + "US");
  EXPECT_NE(at, std::string::npos);
  return bytes.replace(at + 8, 2, le(static_cast<unsigned>(value)));
}

// Larger than the phantom, for the smallest picture that GDCM can write as JPEG 2000.
constexpr std::uint32_t kWidth = 72, kHeight = 64;

/// A slice of 16-bit values that differ from slice to slice: a ramp with noise, mostly below 0.
std::string slice(const Dicom& header) {
  std::string bytes = dicom(header);
  bytes.resize(bytes.size() - 44);  // the phantom's pixels and their length
  const auto add = [&](std::uint32_t value, int count) {
    for (int i = 0; i < count; ++i) bytes += static_cast<char>(value >> 8 * i & 255);
  };
  add(2 * kWidth * kHeight, 4);
  for (std::uint32_t i = 0; i < kWidth * kHeight; ++i)
    add(i / 3 - 1000 + 50 * header.k + i * 2654435761u % 97, 2);
  return with_us(with_us(bytes, 0x28, 0x0010, kHeight), 0x28, 0x0011, kWidth);
}

void write_series(const Folder& folder, double slope_step = 0) {
  for (std::uint32_t k = 0; k < 3; ++k)
    folder.write(std::to_string(k), slice({.k = k, .slope = 1 + slope_step * k}));
}

void expect_same(const Volume& a, const Volume& b) {
  EXPECT_EQ(a.dims, b.dims);
  EXPECT_EQ(a.type, b.type);
  EXPECT_EQ(a.voxels, b.voxels);
  for (int i = 0; i < 3; ++i) EXPECT_LT(glm::length(a.axes[i] - b.axes[i]), 1e-9);
  EXPECT_LT(glm::length(a.origin - b.origin), 1e-9);
  EXPECT_EQ(a.slope, b.slope);
}

TEST(VolumeDicom, LosslessCompressionChangesNothing) {
  for (const double slope_step : {0.0, 0.5}) {
    const Folder plain;
    write_series(plain, slope_step);
    const auto expected = expect_read(plain.path());
    ASSERT_EQ(expected.voxel_count(), 3 * kWidth * kHeight);
    for (const auto syntax : kLossless) {
      SCOPED_TRACE(gdcm::TransferSyntax::GetTSString(syntax));
      const Folder folder;
      write_series(folder, slope_step);
      for (const auto* name : {"0", "1", "2"}) compress(folder.path(name), syntax);
      folder.write("NOTE.txt", "not DICOM");
      ASSERT_TRUE(volume_io::read_dicom_slices(folder.path("0"))->front().compressed);
      expect_same(expect_read(folder.path()), expected);
    }
  }
}

TEST(VolumeDicom, MixedCompressions) {
  const Folder plain, folder;
  write_series(plain);
  write_series(folder);
  compress(folder.path("0"), kLossless[0]);
  compress(folder.path("2"), kLossless[3]);
  expect_same(expect_read(folder.path()), expect_read(plain.path()));
}

// 12 bits of 16, signed and not: what lies beside them is no part of the value.
TEST(VolumeDicom, OnlyStoredBitsCount) {
  for (const int is_signed : {0, 1}) {
    const Folder folder;
    write_series(folder);
    for (const auto* name : {"0", "1", "2"}) {
      auto bytes = with_us(content(folder.path(name)), 0x28, 0x0101, 12);
      bytes = with_us(with_us(bytes, 0x28, 0x0102, 11), 0x28, 0x0103, is_signed);
      bytes.replace(bytes.size() - 2 * kWidth * kHeight, 2, "\xfe\xaf",
                    2);  // the slice's first voxel
      folder.write(name, bytes);
    }
    const auto plain = expect_read(folder.path());
    EXPECT_EQ(plain.type, is_signed ? ScalarType::i16 : ScalarType::u16);
    EXPECT_EQ(value_at(plain, 0, 0, 0), is_signed ? -2 : 0xffe);
  }
  // With the unused bits clean, as writers leave them, compression agrees.
  for (const auto syntax : kLossless) {
    SCOPED_TRACE(gdcm::TransferSyntax::GetTSString(syntax));
    const Folder folder;
    write_series(folder);
    for (const auto* name : {"0", "1", "2"}) {
      auto bytes = with_us(content(folder.path(name)), 0x28, 0x0101, 12);
      bytes = with_us(with_us(bytes, 0x28, 0x0102, 11), 0x28, 0x0103, 0);
      for (std::size_t i = 1; i < 2 * kWidth * kHeight; i += 2) bytes[bytes.size() - i] &= 15;
      folder.write(name, bytes);
    }
    const auto plain = expect_read(folder.path());
    for (const auto* name : {"0", "1", "2"}) compress(folder.path(name), syntax);
    expect_same(expect_read(folder.path()), plain);
  }
}

std::string deflated(const std::string& bytes) {
  // The data set begins after the meta elements, whose length the first one holds.
  const auto meta = static_cast<unsigned char>(bytes[140]);
  const std::size_t from = 144 + meta;
  z_stream stream{};
  deflateInit2(&stream, 9, Z_DEFLATED, -15, 8, Z_DEFAULT_STRATEGY);
  std::string packed(bytes.size(), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data() + from));
  stream.avail_in = static_cast<uInt>(bytes.size() - from);
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  EXPECT_EQ(deflate(&stream, Z_FINISH), Z_STREAM_END);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  return bytes.substr(0, from) + packed;
}

TEST(VolumeDicom, DeflatedIsInflated) {
  const Folder plain, folder;
  write_series(plain);
  for (std::uint32_t k = 0; k < 3; ++k)
    folder.write(std::to_string(k), deflated(slice({.syntax = "1.2.840.10008.1.2.1.99", .k = k})));
  expect_same(expect_read(folder.path()), expect_read(plain.path()));
  const auto whole = content(folder.path("1"));
  for (std::size_t cut = 1; cut < 400; cut += 7) {
    folder.write("1", whole.substr(0, whole.size() - cut));
    const auto volume = read_volume(folder.path());
    ASSERT_FALSE(volume) << cut;
    EXPECT_THAT(volume.error().message, HasSubstr("damaged or cut"));
  }
}

TEST(VolumeDicom, OneFileStandsForItsSeries) {
  const Folder folder;
  write_series(folder);
  const auto expected = expect_read(folder.path());
  folder.write("another", dicom({.series = "1.2.9", .samples = 3}));  // would be refused
  EXPECT_FALSE(read_volume(folder.path()));
  expect_same(expect_read(folder.path("1")), expected);
}

std::string le(std::uint32_t value, int count) {
  std::string bytes;
  for (int i = 0; i < count; ++i) bytes += static_cast<char>(value >> 8 * i & 255);
  return bytes;
}

std::string tag(std::uint32_t value) { return le(value >> 16, 2) + le(value & 0xffff, 2); }

std::string item(const std::string& inner) {
  return tag(0xfffee000) + le(std::uint32_t(inner.size()), 4) + inner;
}

std::string sequence(std::uint32_t of, const std::string& items) {
  return tag(of) + "SQ" + le(0, 2) + le(std::uint32_t(items.size()), 4) + items;
}

std::string decimals(std::uint32_t of, std::string text) {
  if (text.size() % 2) text += ' ';
  return tag(of) + "DS" + le(std::uint32_t(text.size()), 2) + text;
}

/// The slices of write_series in one enhanced file, the frames in the order given.
std::string enhanced(const std::vector<std::uint32_t>& order) {
  std::string groups, pixels;
  for (const auto k : order) {
    const auto at = phantom_origin() + phantom_axes()[2] * double(k);
    std::ostringstream place;
    place << at.x << '\\' << at.y << '\\' << at.z;
    groups += item(sequence(0x00209113, item(decimals(0x00200032, place.str()))));
    const auto one = slice({.k = k});
    pixels += one.substr(one.size() - 2 * kWidth * kHeight);
  }
  auto bytes = slice({.frames = std::to_string(order.size()), .placed = false});
  bytes.resize(bytes.size() - 2 * kWidth * kHeight - 12);
  const auto axes = phantom_axes();
  const auto row = glm::normalize(axes[0]), column = glm::normalize(axes[1]);
  std::ostringstream directions;
  directions << row.x << '\\' << row.y << '\\' << row.z << '\\' << column.x << '\\' << column.y
             << '\\' << column.z;
  return bytes +
         sequence(0x52009229,
                  item(sequence(0x00209116, item(decimals(0x00200037, directions.str()))))) +
         sequence(0x52009230, groups) + tag(0x7fe00010) + "OW" + le(0, 2) +
         le(std::uint32_t(pixels.size()), 4) + pixels;
}

TEST(VolumeDicom, MultiFrameFileIsAVolume) {
  const Folder plain, folder;
  write_series(plain);
  const auto expected = expect_read(plain.path());
  const auto path = folder.write("a", enhanced({2, 0, 1}));
  expect_same(expect_read(path), expected);
  expect_same(expect_read(folder.path()), expected);
  folder.write("a", enhanced({0, 1, 1}));
  EXPECT_THAT(read_volume(path).error().message, HasSubstr("same place"));
  const auto whole = enhanced({0, 1, 2});
  folder.write("a", whole.substr(0, whole.size() - 1));
  EXPECT_FALSE(read_volume(path));
  folder.write("a", enhanced({0, 1}));
  folder.write("b", enhanced({2, 1}));
  EXPECT_THAT(read_volume(folder.path()).error().message, HasSubstr("same place"));
}

// Each flip decodes to something else or to nothing; the process and the other slices stay whole.
TEST(VolumeDicom, DamagedCompressedPixelsAreAnErrorOrOtherPixels) {
  int errors = 0;
  for (const auto syntax : kLossless) {
    SCOPED_TRACE(gdcm::TransferSyntax::GetTSString(syntax));
    const Folder folder;
    write_series(folder);
    for (const auto* name : {"0", "1", "2"}) compress(folder.path(name), syntax);
    const auto expected = expect_read(folder.path());
    const auto whole = content(folder.path("1"));
    const auto pixels = whole.rfind(std::string("\xe0\x7f\x10\x00", 4));
    ASSERT_NE(pixels, std::string::npos);
    const std::size_t bits = 8 * (whole.size() - pixels);
    for (std::size_t i = 0; i < 80; ++i) {
      const std::size_t bit = 8 * pixels + i * bits / 80;
      std::string flipped = whole;
      flipped[bit / 8] = static_cast<char>(flipped[bit / 8] ^ (1 << bit % 8));
      folder.write("1", flipped);
      ::testing::internal::CaptureStderr();
      const auto volume = read_volume(folder.path());
      ASSERT_EQ(::testing::internal::GetCapturedStderr(), "");
      if (!volume) {
        ++errors;
        ASSERT_THAT(volume.error().message, StartsWith(folder.path("1")));
        continue;
      }
      ASSERT_EQ(volume->voxels.size(), expected.voxels.size());
      const std::size_t slice = expected.voxels.size() / 3;
      for (const std::size_t other : {std::size_t{0}, 2 * slice})
        ASSERT_TRUE(std::equal(volume->voxels.begin() + std::ptrdiff_t(other),
                               volume->voxels.begin() + std::ptrdiff_t(other + slice),
                               expected.voxels.begin() + std::ptrdiff_t(other)));
    }
    for (std::size_t length = pixels; length < whole.size(); length += 1 + whole.size() / 50) {
      folder.write("1", whole.substr(0, length));
      ASSERT_FALSE(read_volume(folder.path())) << "cut to " << length << " of " << whole.size();
    }
  }
  EXPECT_GT(errors, 20);
}

// What GDCM itself dies of, where our parser does not see it: no stream after a whole header.
TEST(VolumeDicom, ErrorNamesFileAndTransferSyntax) {
  const Folder folder;
  write_series(folder);
  for (const auto* name : {"0", "1", "2"}) compress(folder.path(name), kLossless[3]);
  auto bytes = content(folder.path("1"));
  const auto stream = bytes.rfind("\xff\x4f\xff\x51");
  ASSERT_NE(stream, std::string::npos);
  std::fill(bytes.begin() + std::ptrdiff_t(stream), bytes.end() - 8, '\x55');
  folder.write("1", bytes);
  const auto volume = read_volume(folder.path());
  ASSERT_FALSE(volume);
  EXPECT_EQ(volume.error().code, ErrorCode::bad_file);
  EXPECT_THAT(volume.error().message, StartsWith(folder.path("1")));
  EXPECT_THAT(volume.error().message,
              HasSubstr("JPEG 2000 lossless (transfer syntax 1.2.840.10008.1.2.4.90)"));
}

// The header, not the stream, says how many pixels there are.
TEST(VolumeDicom, StreamOfAnotherSizeIsAnError) {
  for (const auto syntax : kLossless) {
    const Folder folder;
    write_series(folder);
    for (const auto* name : {"0", "1", "2"}) {
      compress(folder.path(name), syntax);
      folder.write(name, with_us(content(folder.path(name)), 0x28, 0x0010, 9000));
    }
    const auto volume = read_volume(folder.path());
    EXPECT_FALSE(volume) << gdcm::TransferSyntax::GetTSString(syntax);
  }
}

}  // namespace
}  // namespace slf
