// read_volume on files that are damaged, lie or are not for us: each must fail with the right code
// and a message that names file, place, what was expected and what was found.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <limits>

#include "slf/volume.h"
#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

class VolumeBadInput : public ::testing::Test {
 protected:
  /// Reads `bytes` as a file of that name and expects this error.
  void expect(const std::string& bytes, const std::string& file, ErrorCode code,
              const std::vector<std::string>& parts, const VolumeOptions& options = {}) {
    expect_at(folder_.write(file, bytes), code, parts, options);
  }

  static void expect_at(const std::string& path, ErrorCode code,
                        const std::vector<std::string>& parts, const VolumeOptions& options = {}) {
    ::testing::internal::CaptureStderr();
    ::testing::internal::CaptureStdout();
    const auto volume = read_volume(path, options);
    EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
    EXPECT_EQ(::testing::internal::GetCapturedStdout(), "");
    ASSERT_FALSE(volume) << path;
    EXPECT_EQ(volume.error().code, code) << volume.error().message;
    EXPECT_THAT(volume.error().message, StartsWith(path.substr(0, path.rfind('/'))));
    for (const auto& part : parts) EXPECT_THAT(volume.error().message, HasSubstr(part));
  }

  Folder folder_;
};

std::string nrrd_with(const std::string& lines, const std::string& sizes = "5 4 3") {
  return nrrd("type: uchar\ndimension: 3\nsizes: " + sizes + "\nencoding: raw\n" + lines,
              phantom_bytes(ScalarType::u8, false));
}

std::string meta_with(const std::string& lines) {
  return "NDims = 3\nDimSize = 5 4 3\nElementType = MET_UCHAR\n" + lines +
         "ElementDataFile = LOCAL\n" + phantom_bytes(ScalarType::u8, false);
}

TEST_F(VolumeBadInput, MissingEmptyOrOfAnotherKind) {
  expect_at(folder_.path("none.nii"), ErrorCode::not_found, {"no such file"});
  expect_at("/dev/null", ErrorCode::io, {"not a regular file"});
  expect("", "empty.nii", ErrorCode::bad_file, {"empty"});
  expect("A text.\n", "a.nrrd", ErrorCode::bad_file, {"NRRD000", "'A text.\\x0a'", "misnamed"});
  expect("A text.\n", "a.nii.gz", ErrorCode::bad_file, {"NIfTI", "'A text.\\x0a'"});
  expect(gzip("A text.\n"), "b.nii.gz", ErrorCode::bad_file,
         {"a NIfTI header", "'A text.\\x0a'", "unpacked from gzip"});
  expect("A text.\n", "a.mha", ErrorCode::bad_file, {"ObjectType"});
  expect("A text.\n", "brain.den", ErrorCode::usage, {"dimensions, type, spacing and offset"});
}

TEST_F(VolumeBadInput, FolderThatMayNotBeEnteredIsNamedSo) {
  std::filesystem::create_directory(folder_.path("closed"));
  const auto path = folder_.write("closed/a.nii", nifti({}));
  std::filesystem::permissions(folder_.path("closed"), std::filesystem::perms::none);
  // For root no folder is closed: be nobody for this call.
  const bool root = ::geteuid() == 0;
  if (root) {
    ASSERT_EQ(::seteuid(65534), 0);
  }
  expect_at(path, ErrorCode::io, {"Permission denied"});
  expect_at(folder_.path("closed"), ErrorCode::io, {"Permission denied"});
  if (root) {
    ASSERT_EQ(::seteuid(0), 0);
  }
  std::filesystem::permissions(folder_.path("closed"), std::filesystem::perms::owner_all);
}

TEST_F(VolumeBadInput, NameDoesNotDecideContentDoes) {
  EXPECT_TRUE(read_volume(folder_.write("plain.nii.gz", nifti({}))));
  EXPECT_TRUE(read_volume(folder_.write("packed.nii", gzip(nifti({})))));
  EXPECT_TRUE(read_volume(folder_.write("nrrd.nii", nrrd_with(""))));
  EXPECT_TRUE(read_volume(folder_.write("nameless", meta_with(""))));
}

TEST_F(VolumeBadInput, HeadersThatLieAboutTheSize) {
  const auto huge = {30000, 30000, 30000};
  expect(nifti({.dim = huge}), "a.nii", ErrorCode::bad_file,
         {"30000x30000x30000", "need 27000000000000 bytes", "holds 412"});
  expect(gzip(nifti({.dim = huge})), "a.nii.gz", ErrorCode::bad_file, {"need 27000000000000"});
  expect(nifti({.version = 2, .dim = {2000000000, 2000000000, 2000000000}}), "b.nii",
         ErrorCode::bad_file, {"absurd dims", "2^63"});
  expect(nifti({.dim = {5, -4, 3}}), "c.nii", ErrorCode::bad_file, {"dim[2] is -4"});
  expect(nifti({.dim = {5, 4, 0}}), "c.nii", ErrorCode::bad_file, {"dim[3] is 0"});
  expect(nrrd_with("", "99999 99999 9"), "a.nrrd", ErrorCode::bad_file,
         {"need 89998200009 bytes", "holds 60 bytes"});
  expect(nrrd_with("", "9999999999 99 9"), "a.nrrd", ErrorCode::bad_file, {"absurd dims"});
  expect(nrrd_with("", "99999999999999999999 9 9"), "a.nrrd", ErrorCode::bad_file, {"'sizes' 0"});
  expect("NDims = 3\nDimSize = 5000 5000 5000\nElementType = MET_DOUBLE\nElementDataFile = LOCAL\n",
         "a.mha", ErrorCode::bad_file, {"need 1000000000000 bytes", "holds 0"});
  // Detached data are held against their own file.
  folder_.write("d.raw", phantom_bytes(ScalarType::u8, false));
  expect(nrrd("type: double\ndimension: 3\nsizes: 5 4 3\nendian: big\nencoding: raw\n"
              "data file: d.raw\n",
              ""),
         "d.nhdr", ErrorCode::bad_file, {"d.raw", "need 480 bytes", "holds 60"});
}

TEST_F(VolumeBadInput, DetachedDataFileIsMissing) {
  expect(nrrd_with("data file: gone.raw\n"), "a.nhdr", ErrorCode::not_found,
         {"gone.raw", "no such file"});
  expect("NDims = 3\nDimSize = 5 4 3\nElementType = MET_UCHAR\nElementDataFile = gone.raw\n",
         "a.mhd", ErrorCode::not_found, {"gone.raw", "no such file"});
  expect(nifti({.magic = "i"}), "a.hdr", ErrorCode::not_found, {"a.img"});
  expect(nrrd_with("data file: /dev/zero\n"), "b.nhdr", ErrorCode::io, {"not a regular file"});
}

TEST_F(VolumeBadInput, SpacingAndAxes) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double spacing : {0.0, -1.0, nan, HUGE_VAL})
    expect(nifti({.pixdim = {1, 1, spacing, 1, 0, 0, 0, 0}, .qform = 1}), "a.nii",
           ErrorCode::bad_file, {"pixdim[2]", "positive"});
  Nifti singular{.sform = 1};
  singular.srow = {1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0};
  expect(nifti(singular), "b.nii", ErrorCode::bad_file, {"singular"});
  singular.srow[3] = nan;
  expect(nifti(singular), "b.nii", ErrorCode::bad_file, {"origin is not finite"});
  singular.srow[0] = nan;
  expect(nifti(singular), "b.nii", ErrorCode::bad_file, {"spacing of axis 0"});
  for (const auto* spacing : {"0", "-1", "inf"}) {
    expect(nrrd_with("spacings: 1 " + std::string(spacing) + " 1\n"), "a.nrrd", ErrorCode::bad_file,
           {"'spacings' 1", "positive"});
    expect(meta_with("ElementSpacing = 1 1 " + std::string(spacing) + "\n"), "a.mha",
           ErrorCode::bad_file, {"'ElementSpacing' 2", "positive"});
  }
  expect(nrrd_with("space: LPS\nspace directions: (1,0,0) (0,1,0) (1,1,0)\n"), "b.nrrd",
         ErrorCode::bad_file, {"singular"});
  expect(meta_with("TransformMatrix = 1 0 0 0 1 0 0 0 nan\n"), "b.mha", ErrorCode::bad_file,
         {"spacing of axis 2"});
}

TEST_F(VolumeBadInput, SeveralComponentsNameTheChoice) {
  expect(nifti({.dim = {5, 4, 3, 7}}), "a.nii", ErrorCode::unsupported,
         {"7 time points", "choose time point 0 to 6"});
  expect(nifti({.dim = {5, 4, 3, 1, 7}}), "a.nii", ErrorCode::unsupported,
         {"7 components", "choose component 0 to 6"});
  expect(nifti({.dim = {5, 4, 3, 2, 2, 2}}), "a.nii", ErrorCode::unsupported,
         {"5x4x3x2x2x2", "extract one"});
  expect(nifti({.datatype = 128}), "a.nii", ErrorCode::unsupported,
         {"3 components", "choose component 0 to 2"});
  expect(nifti({.datatype = 128}), "a.nii", ErrorCode::usage, {"component 3 was chosen", "has 3"},
         {.component = 3});
  expect(nifti({}), "a.nii", ErrorCode::usage, {"time point 1 was chosen", "has 1"}, {.time = 1});
  expect(nifti({}), "a.nii", ErrorCode::usage, {"component 1 was chosen", "has 1"},
         {.component = 1});
  expect(nrrd("type: uchar\ndimension: 4\nsizes: 3 5 4 3\nkinds: RGB-color domain domain domain\n"
              "encoding: raw\n",
              std::string(180, 'x')),
         "a.nrrd", ErrorCode::unsupported, {"3 components", "choose component 0 to 2"});
  expect(nrrd("type: uchar\ndimension: 3\nsizes: 3 5 4\nkinds: vector domain domain\n"
              "encoding: raw\n",
              std::string(60, 'x')),
         "a.nrrd", ErrorCode::unsupported, {"3 ('vector')x5 ('domain')"});
  expect(nrrd("type: uchar\ndimension: 4\nsizes: 5 3 4 3\nkinds: domain vector domain vector\n"
              "encoding: raw\n",
              std::string(180, 'x')),
         "a.nrrd", ErrorCode::unsupported, {"5 ('domain')x3 ('vector')", "unu slice"});
  expect(meta_with("ElementNumberOfChannels = 3\n"), "a.mha", ErrorCode::unsupported,
         {"3 components"});
  expect(meta_with("ElementNumberOfChannels = 0\n"), "a.mha", ErrorCode::bad_file,
         {"'ElementNumberOfChannels' is '0'"});
}

TEST_F(VolumeBadInput, CropsAndSpacingsThatDoNotFit) {
  expect(nifti({}), "a.nii", ErrorCode::usage, {"crop from 1 to 9 along x", "within 0 to 5"},
         {.crop = VoxelBox{{1, 0, 0}, {9, 0, 0}}});
  expect(nifti({}), "a.nii", ErrorCode::usage, {"crop from 2 to 3 along y", "at least 2 voxels"},
         {.crop = VoxelBox{{0, 2, 0}, {0, 3, 0}}});
  expect(nifti({}), "a.nii", ErrorCode::usage, {"spacing 1 is 0", "positive"},
         {.spacing = glm::dvec3(1, 0, 1)});
}

TEST_F(VolumeBadInput, OneSliceIsNoVolume) {
  expect(nifti({.dim = {5, 12}}), "a.nii", ErrorCode::unsupported, {"picture of 2 dimensions"});
  expect(nrrd_with("", "20 3 1"), "a.nrrd", ErrorCode::unsupported, {"20x3x1", "single slice"});
  expect(nifti({}), "a.raw", ErrorCode::usage, {"single slice"},
         {.raw = RawLayout{.dims = {4, 4, 1}}});
}

TEST_F(VolumeBadInput, RawLayoutThatDoesNotFit) {
  const std::string bytes(100, 'x');
  expect(bytes, "a.raw", ErrorCode::usage, {"need 120 bytes", "100 bytes in all"},
         {.raw = RawLayout{.dims = {5, 4, 3}, .type = ScalarType::u16}});
  expect(bytes, "a.raw", ErrorCode::usage, {"offset 62", "need 60", "100"},
         {.raw = RawLayout{.dims = {5, 4, 3}, .offset = 62}});
  expect(bytes, "a.raw", ErrorCode::usage, {"spacing along axis 1 is -2"},
         {.raw = RawLayout{.dims = {5, 4, 3}, .spacing = {1, -2, 1}}});
  expect_at(folder_.path(), ErrorCode::usage, {"a folder"}, {.raw = RawLayout{.dims = {5, 4, 3}}});
}

TEST_F(VolumeBadInput, HeaderFieldsThatDoNotParse) {
  const auto bad = [&](const std::string& lines, const std::vector<std::string>& parts) {
    expect(nrrd(lines, std::string(60, 'x')), "a.nrrd", ErrorCode::bad_file, parts);
  };
  bad("type: uchar\nsizes: 5 4 3\nencoding: raw\n", {"no 'dimension:'"});
  bad("type: quark\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n", {"'type' is 'quark'"});
  bad("type: uchar\ndimension: 99\nsizes: 5\nencoding: raw\n", {"'dimension' is '99'"});
  bad("type: uchar\ndimension: 3\nsizes: 5 4\nencoding: raw\n", {"has 2 values", "expected 3"});
  bad("type: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: lzma\n", {"'encoding' is 'lzma'"});
  bad("type: short\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n", {"'endian'", "endian: little"});
  bad("type: uchar\nnonsense\n", {"line 4", "'nonsense'"});
  expect(nrrd("type: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: hex\n", ""), "a.nrrd",
         ErrorCode::unsupported, {"hex", "unu save"});
  expect(nrrd("type: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: bzip2\n", "voxels"), "a.nrrd",
         ErrorCode::bad_file, {"not bzip2"});
  expect(meta_with("BinaryData = False\n"), "a.mha", ErrorCode::unsupported, {"text"});
  expect("NDims = 3\nDimSize = 5 4 3\n", "a.mha", ErrorCode::bad_file, {"ElementDataFile"});
  expect(meta_with("CompressedData = perhaps\n"), "a.mha", ErrorCode::bad_file,
         {"'CompressedData' is 'perhaps'"});
}

TEST_F(VolumeBadInput, PackedDataThatAreShortOrDamaged) {
  const std::string whole = gzip(nifti({.type = ScalarType::f64}));
  expect(whole.substr(0, whole.size() - 20), "a.nii.gz", ErrorCode::bad_file, {"truncated"});
  // Cut in the checksum: the voxels are all there, the file is not.
  expect(whole.substr(0, whole.size() - 3), "a.nii.gz", ErrorCode::bad_file, {"truncated"});
  auto flipped = whole;
  flipped[flipped.size() - 6] ^= 1;  // the checksum itself
  expect(flipped, "a.nii.gz", ErrorCode::bad_file, {"damaged"});
}

TEST_F(VolumeBadInput, DicomFolders) {
  expect_at(folder_.path(), ErrorCode::bad_file, {"holds no files"});
  const auto slice = [](const Dicom& d) { return dicom(d); };
  const Folder series, same, gap, frames, unplaced, cut, one;
  series.write("1", slice({.series = "1.2.3", .k = 0}));
  series.write("2", slice({.series = "1.2.3", .k = 1}));
  series.write("3", slice({.series = "1.2.9", .k = 0}));
  expect_at(series.path(), ErrorCode::unsupported,
            {"1.2.3 (CT 5x4, 2 slices)", "1.2.9 (CT 5x4, 1 slice)"});
  frames.write("1", slice({.frames = "12"}));
  expect_at(frames.path(), ErrorCode::bad_file, {"12 frames", "need 480 bytes"});
  unplaced.write("1", slice({.placed = false}));
  expect_at(unplaced.path(), ErrorCode::bad_file, {"ImagePositionPatient"});
  same.write("1", slice({.k = 1}));
  same.write("2", slice({.k = 1, .intercept = 1}));
  expect_at(same.path(), ErrorCode::unsupported, {"same place"});
  for (const std::uint32_t k : {0, 1, 2}) gap.write(std::to_string(k), slice({.k = k}));
  gap.write("4", slice({.k = 2, .shift = {0, 0, -6}}));  // where k = 4 would be
  expect_at(gap.path(), ErrorCode::bad_file, {"not evenly spaced", "missing"});
  const auto whole = slice({});
  cut.write("1", whole.substr(0, whole.size() - 7));
  expect_at(cut.path(), ErrorCode::bad_file, {"claims 40 bytes", "truncated"});
  one.write("1", whole);
  expect_at(one.path(), ErrorCode::unsupported, {"5x4x1", "single slice"});
  expect_at(one.path("1"), ErrorCode::unsupported, {"the single slice of its series"});
}

/// Every format, whole.
std::vector<std::pair<std::string, std::string>> samples_of_every_format() {
  Nifti placed{.type = ScalarType::i16, .slope = 2, .qform = 1, .sform = 2};
  placed.srow = phantom_srow();
  return {{"a.nii", nifti(placed)},
          {"b.nii", nifti({.version = 2, .big_endian = true, .type = ScalarType::f32})},
          {"a.nii.gz", gzip(nifti(placed))},
          {"a.nrrd", phantom_nrrd(ScalarType::u16, true, "RAS")},
          {"b.nrrd", nrrd("type: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: gzip\n",
                          gzip(phantom_bytes(ScalarType::u8, false)))},
          {"a.mha", phantom_meta(ScalarType::i16, false, true)},
          {"b.mha", phantom_meta(ScalarType::f64, true, false)}};
}

TEST_F(VolumeBadInput, TruncatedAnywhereIsAnError) {
  for (const auto& [file, bytes] : samples_of_every_format()) {
    ASSERT_TRUE(read_volume(folder_.write(file, bytes))) << file;
    expect_cuts_refused(folder_, file, bytes);
  }
}

// In the same series as whole ones, so that the cut file alone is at fault. Cut before it names its
// series, it may be of any, and cut between two elements it may be no picture: then it is skipped
// and named.
TEST_F(VolumeBadInput, TruncatedDicomIsAnErrorOrNamed) {
  for (const std::uint32_t k : {0, 1, 2}) folder_.write(std::to_string(k), dicom({.k = k}));
  ASSERT_TRUE(read_volume(folder_.path()));
  const auto bytes = dicom({.k = 1});
  for (std::size_t length = 132; length < bytes.size(); ++length) {
    folder_.write("1", bytes.substr(0, length));
    const auto volume = read_volume(folder_.path());
    if (volume) {
      ASSERT_THAT(volume->notes, ElementsAre(HasSubstr(folder_.path("1"))));
    }
  }
}

TEST_F(VolumeBadInput, FlippedBitsGiveAnErrorOrAVolumeThatHoldsTogether) {
  for (const auto& [file, bytes] : samples_of_every_format()) {
    const std::size_t header = std::min<std::size_t>(bytes.size(), 560);
    for (std::size_t bit = 0; bit < 8 * header; bit += 3) {
      std::string flipped = bytes;
      flipped[bit / 8] = static_cast<char>(flipped[bit / 8] ^ (1 << bit % 8));
      const auto volume = read_volume(folder_.write(file, flipped));
      if (!volume) {
        ASSERT_THAT(volume.error().message, StartsWith(folder_.path()));
        continue;
      }
      ASSERT_EQ(volume->voxels.size(), volume->voxel_count() * bytes_per_voxel(volume->type));
      ASSERT_GT(std::abs(glm::determinant(volume->axes)), 0);
    }
  }
}

}  // namespace
}  // namespace slf
