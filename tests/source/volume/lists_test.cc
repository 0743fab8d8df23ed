// Headers whose voxels are in several data files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::IsSupersetOf;

class VolumeLists : public ::testing::Test {
 protected:
  /// Slices "s/7.raw", "s/8.raw", "s/9.raw" of the phantom, each after two bytes.
  void SetUp() override {
    const std::string phantom = phantom_bytes(ScalarType::i16, true);
    for (std::size_t k = 0; k < 3; ++k)
      folder_.write("s/" + std::to_string(7 + k) + ".raw", "##" + phantom.substr(40 * k, 40));
  }

  std::string meta(const std::string& last, const std::string& more = "HeaderSize = 2\n") const {
    return folder_.write(
        "a.mhd",
        "NDims = 3\nDimSize = 5 4 3\nElementType = MET_SHORT\nElementSpacing = 1 1 "
        "1\nBinaryDataByteOrderMSB = True\n" +
            more + "ElementDataFile = " + last);
  }
  std::string nhdr(const std::string& last, const std::string& more = "byte skip: 2\n",
                   const std::string& encoding = "raw") const {
    return folder_.write("a.nhdr",
                         "NRRD0004\ntype: short\ndimension: 3\nsizes: 5 4 3\nspacings: 1 1 1\n"
                         "endian: big\nencoding: " +
                             encoding + "\n" + more + "data file: " + last);
  }

  Folder folder_;
};

TEST_F(VolumeLists, ReadsAListOrNumberedFiles) {
  const std::string names = "s/7.raw\ns/8.raw\ns/9.raw\n";
  for (const auto& path :
       {meta("LIST\n" + names), meta("LIST 2\n" + names), meta("LIST 2D\n" + names),
        meta("s/%d.raw 7 9 1\n"), meta("s/%d.raw 7 9\n"), meta("s/%01i.raw 7\n"),
        meta("LIST\n" + names, "HeaderSize = -1\n")}) {
    const auto volume = expect_read(path);
    expect_phantom(volume, ScalarType::i16);
    EXPECT_THAT(volume.notes, IsEmpty());
    EXPECT_THAT(volume.files, IsSupersetOf({folder_.path("s/7.raw"), folder_.path("s/9.raw")}));
  }
  for (const auto& last : {"LIST\n" + names, "LIST 2\n" + names, "LIST 3\n" + names,
                           std::string("s/%d.raw 7 9 1\n"), std::string("s/%d.raw 7 9 1 2\n")})
    for (const auto* skip : {"byte skip: 2\n", "byte skip: -1\n"})
      expect_phantom(expect_read(nhdr(last, skip)), ScalarType::i16);
}

// Whoever wrote the header, and wherever its data were then.
TEST_F(VolumeLists, FindsDataThatWereMoved) {
  for (const std::string from : {"/elsewhere/s/", "C:\\data\\s\\", "S\\"}) {
    const auto list = "LIST\n" + from + "7.raw\n" + from + "8.RAW\n" + from + "9.raw\n";
    for (const auto& path : {meta(list), nhdr(list), meta(from + "%d.raw 7 9 1\n")}) {
      const auto volume = expect_read(path);
      expect_phantom(volume, ScalarType::i16);
      EXPECT_EQ(volume.notes.size(), from == "S\\" ? 0u : 1u);
    }
  }
}

TEST_F(VolumeLists, HeadersMayBeginWithAByteOrderMark) {
  for (const std::string& path : {meta("s/%d.raw 7 9 1\n"), nhdr("s/%d.raw 7 9 1\n")}) {
    std::ifstream file(path);
    const std::string text(std::istreambuf_iterator<char>(file), {});
    const auto name = "bom" + path.substr(path.rfind('.'));
    expect_phantom(expect_read(folder_.write(name, "\xEF\xBB\xBF" + text)), ScalarType::i16);
  }
}

TEST_F(VolumeLists, UnitsHaveManyNames) {
  const std::string last = "s/%d.raw 7 9 1\n", skip = "byte skip: 2\n";
  for (const std::string unit : {"mm", "microns", "nanometers", "\xC2\xB5m"}) {
    const std::string all = '"' + unit + "\"  \"" + unit + "\" \"" + unit + "\"\n";
    EXPECT_EQ(expect_read(nhdr(last, skip + "units: " + all)).unit, unit);
    EXPECT_EQ(expect_read(meta(last, "HeaderSize = 2\nDistanceUnits = " + unit + "\n")).unit, unit);
  }
  EXPECT_EQ(expect_read(nhdr(last, skip + "units: \"mm\" \"mm\" \"um\"\n")).unit, "");
  EXPECT_EQ(expect_read(meta(last, "HeaderSize = 2\nDistanceUnits = ?\n")).unit, "");
}

TEST_F(VolumeLists, ValuesHaveTheUnitOfTheSamples) {
  const std::string last = "s/%d.raw 7 9 1\n", skip = "byte skip: 2\n";
  EXPECT_EQ(expect_read(nhdr(last, skip + "sample units: \"HU\"\n")).value_unit, "HU");
  EXPECT_EQ(expect_read(nhdr(last, skip)).value_unit, "");
}

TEST_F(VolumeLists, NumbersMayRunBackwardsAndHaveZeros) {
  const std::string phantom = phantom_bytes(ScalarType::i16, true);
  for (std::size_t k = 0; k < 3; ++k)
    folder_.write("z_" + std::string(1, static_cast<char>('8' - 2 * k)).insert(0, "00") + ".raw",
                  phantom.substr(40 * k, 40));
  expect_phantom(expect_read(nhdr("z_%03d.raw 8 4 -2\n", "")), ScalarType::i16);
  expect_phantom(expect_read(meta("z_%03d.raw 8 4 -2\n", "")), ScalarType::i16);
}

TEST_F(VolumeLists, EachFileIsPackedByItself) {
  const std::string phantom = phantom_bytes(ScalarType::i16, true);
  for (std::size_t k = 0; k < 3; ++k)
    folder_.write(std::to_string(k) + ".gz", gzip(phantom.substr(40 * k, 40)));
  expect_phantom(expect_read(nhdr("%d.gz 0 2 1\n", "", "gzip")), ScalarType::i16);
}

// A file may hold several slices, or volumes.
TEST_F(VolumeLists, FilesOfOtherDimensions) {
  const std::string phantom = phantom_bytes(ScalarType::u8, false), zeros(60, '\0');
  folder_.write("v0.raw", zeros);
  folder_.write("v1.raw", phantom);
  const auto times = folder_.write(
      "t.mhd",
      "NDims = 4\nDimSize = 5 4 3 2\nElementType = MET_UCHAR\nElementSpacing = 1 1 1 1\n"
      "ElementDataFile = LIST 3\nv0.raw\nv1.raw\n");
  expect_phantom(expect_read(times, {.time = 1}), ScalarType::u8);
  std::string components =
      "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 5 4 3 2\nkinds: domain "
      "domain domain vector\nencoding: raw\ndata file: LIST\nv0.raw\nv1.raw\n";
  expect_phantom(expect_read(folder_.write("c.nhdr", components), {.component = 1}),
                 ScalarType::u8);
}

TEST_F(VolumeLists, SaysWhatIsWrong) {
  const auto bad = ErrorCode::bad_file;
  expect_error(meta("LIST\ns/7.raw\ns/8.raw\n"), bad,
               "names 2 data files, but its 'DimSize' needs 3, each of 2 dimensions");
  expect_error(nhdr("LIST\ns/7.raw\ns/8.raw\n"), bad,
               "names 2 data files, but its 'sizes' need 3, each of 2 dimensions");
  expect_error(nhdr("s/%d.raw 7 8 1\n"), bad, "names 2 data files");
  for (const auto* gone : {"LIST\ns/7.raw\ns/gone.raw\ns/9.raw\n"}) {
    expect_error(meta(gone), ErrorCode::not_found, "data file 2 of 3 cannot be read");
    expect_error(nhdr(gone), ErrorCode::not_found, "gone.raw: no such file");
  }
  folder_.write("s/8.raw", "##short");
  expect_error(nhdr("s/%d.raw 7 9 1\n"), bad, "8.raw: 5x4x3 voxels of i16 need 40 bytes");
  for (const auto* pattern : {"s/%s.raw 7 9 1\n", "s/%d%d.raw 7 9 1\n", "s/%999d.raw 7 9 1\n"})
    expect_error(nhdr(pattern), bad, "expected one %d for their numbers");
  for (const auto* range :
       {"9 7 1", "7 9 0", "0 99999999 1", "7 99999999999999 1",
        "-9223372036854775808 -9223372036854775808 1", "7 6 -9223372036854775808"})
    expect_error(nhdr("s/%d.raw " + std::string(range) + "\n"), bad, "data files numbered");
  expect_error(nhdr("s/%d.raw 7 9 x\n"), bad, "'PATTERN MIN MAX STEP'");
  expect_error(meta("LIST x\ns/7.raw\n"), bad, "'LIST'");
  for (const auto* range : {"-9223372036854775808", "7 1073741825", "7 6 -9223372036854775808"})
    expect_error(meta("s/%d.raw " + std::string(range) + "\n"), bad, "first and last number");
  expect_error(nhdr("s/%d.raw 7 9 1\n", "line skip: 1\n"), ErrorCode::unsupported, "'line skip'");
}

TEST_F(VolumeLists, LongerFilesAreSaidSo) {
  EXPECT_THAT(expect_read(nhdr("s/%d.raw 7 9 1\n", "")).notes,
              ElementsAre(HasSubstr("7.raw has 42 bytes, but 5x4x3 voxels of i16 need 40")));
}

}  // namespace
}  // namespace slf
