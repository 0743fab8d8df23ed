// Choices that all formats share: component, time, crop, spacing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "source/volume/units.h"
#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(VolumeChoices, TimesAndComponentsOfTheOlderFormats) {
  const Folder folder;
  const std::string phantom = phantom_bytes(ScalarType::u8, false), zeros(60, '\0');
  std::string rgb;
  for (const char c : phantom) rgb += std::string(1, '\x07') + c + std::string(1, '\x09');
  const auto header = nifti({.dim = {5, 4, 3, 2}}).substr(0, 352);
  for (const bool packed : {false, true}) {
    const auto write = [&](const std::string& name, const std::string& bytes) {
      return folder.write(name, packed ? gzip(bytes) : bytes);
    };
    expect_phantom(expect_read(write("a.nii", header + zeros + phantom), {.time = 1}),
                   ScalarType::u8);
    expect_phantom(expect_read(write("b.nii", nifti({.datatype = 128}).substr(0, 352) + rgb),
                               {.component = 1}),
                   ScalarType::u8);
  }
  expect_phantom(expect_read(folder.write("c.nii", nifti({.dim = {5, 4, 3, 2, 2}}).substr(0, 352) +
                                                       zeros + zeros + zeros + phantom),
                             {.component = 1, .time = 1}),
                 ScalarType::u8);
  expect_phantom(
      expect_read(folder.write("a.nrrd", nrrd("type: uchar\ndimension: 5\nsizes: 3 5 4 3 2\nkinds: "
                                              "RGB-color domain domain domain time\n"
                                              "encoding: raw\nbyte skip: -1\n",
                                              zeros + zeros + zeros + rgb)),
                  {.component = 1, .time = 1}),
      ScalarType::u8);
  expect_phantom(expect_read(folder.write("a.mha",
                                          "NDims = 4\nDimSize = 5 4 3 2\nElementType = MET_UCHAR\n"
                                          "ElementNumberOfChannels = 3\nElementDataFile = LOCAL\n" +
                                              zeros + zeros + zeros + rgb),
                             {.component = 1, .time = 1}),
                 ScalarType::u8);
}

TEST(VolumeChoices, OnlyDicomHasSeries) {
  const Folder folder;
  const VolumeOptions chosen{.series = "3"};
  const std::string phantom = phantom_bytes(ScalarType::u8, false);
  for (const auto& path : {folder.write("a.nii", nifti({})),
                           folder.write("a.nrrd", phantom_nrrd(ScalarType::u8, false, "RAS"))})
    expect_error(path, ErrorCode::usage, "series '3' was chosen, but this is not DICOM", chosen);
  VolumeOptions raw = chosen;
  raw.raw = RawLayout{.dims = kDims};
  expect_error(folder.write("a.raw", phantom), ErrorCode::usage, "not DICOM", raw);
  const Folder pictures;
  pictures.write("1.png", "\x89PNG\r\n\x1a\n");
  expect_error(pictures.path(), ErrorCode::usage, "not DICOM", chosen);
}

TEST(VolumeChoices, CropKeepsItsPlaceInTheWorld) {
  const Folder folder;
  Nifti header{.type = ScalarType::i16, .sform = 1};
  header.srow = phantom_srow();
  const auto path = folder.write("a.nii", nifti(header));
  const auto whole = expect_read(path);
  const auto part = expect_read(path, {.crop = VoxelBox{{1, 0, 1}, {4, 3, 0}}});
  EXPECT_THAT(part.dims, ElementsAre(3, 3, 2));
  for (std::uint32_t k = 0; k < 2; ++k)
    for (std::uint32_t j = 0; j < 3; ++j)
      for (std::uint32_t i = 0; i < 3; ++i) {
        EXPECT_EQ(value_at(part, i, j, k), value_at(whole, i + 1, j, k + 1));
        EXPECT_LT(glm::length(world_of(part, i, j, k) - world_of(whole, i + 1, j, k + 1)), 1e-9);
      }
}

// Components and times, wherever their axes are: each phantom is stored beside zeros.
TEST(VolumeChoices, NrrdAxesOfComponentsAndTimesMayBeAnywhere) {
  const Folder folder;
  const std::string phantom = phantom_bytes(ScalarType::u8, false);
  struct Layout {
    std::string sizes, kinds;
    std::size_t run;  // voxels of the phantom between zeros
    VolumeOptions options;
  };
  const VolumeOptions component{.component = 1}, time{.time = 1};
  for (const auto& [sizes, kinds, run, options] :
       {Layout{"2 5 4 3", "vector domain domain domain", 1, component},
        Layout{"5 2 4 3", "domain vector domain domain", 5, component},
        Layout{"5 4 2 3", "domain domain vector domain", 20, component},
        Layout{"5 4 3 2", "domain domain domain vector", 60, component},
        Layout{"2 5 4 3", "time domain domain domain", 1, time},
        Layout{"5 4 2 3", "domain domain time domain", 20, time},
        Layout{"5 4 3 2", "domain domain domain list", 60, time},
        Layout{"5 4 3 2", "domain domain domain time", 60, time}}) {
    SCOPED_TRACE(kinds);
    std::string data;
    for (std::size_t at = 0; at < phantom.size(); at += run)
      data += std::string(run, '\0') + phantom.substr(at, run);
    const auto path = folder.write("a.nrrd", nrrd("type: uchar\ndimension: 4\nsizes: " + sizes +
                                                      "\nkinds: " + kinds + "\nencoding: raw\n",
                                                  data));
    expect_error(path, ErrorCode::unsupported, options.time ? "2 time points" : "2 components");
    expect_phantom(expect_read(path, options), ScalarType::u8);
  }
  // Two that are not of space: beside each other or on both sides.
  const auto two = [&](const std::string& sizes, const std::string& kinds,
                       const std::string& data) {
    return folder.write("b.nrrd", nrrd("type: uchar\ndimension: 5\nsizes: " + sizes +
                                           "\nkinds: " + kinds + "\nencoding: raw\n",
                                       data));
  };
  std::string inner, outer = std::string(180, '\0') + phantom;
  for (const char c : phantom) inner += std::string(3, '\0') + c;
  for (const auto& path : {two("2 2 5 4 3", "vector time domain domain domain", inner),
                           two("5 4 3 2 2", "domain domain domain vector time", outer)})
    expect_phantom(expect_read(path, {.component = 1, .time = 1}), ScalarType::u8);
  expect_error(two("2 5 2 4 3", "vector domain time domain domain", inner), ErrorCode::unsupported,
               "one of space between them", {.component = 1, .time = 1});
}

TEST(VolumeChoices, MicrometresInAnyEncoding) {
  const Folder folder;
  for (const std::string unit : {"\u00b5m", "\u03bcm", "\xb5m", "\u00c2\u00b5m", "um", "Microns"}) {
    const auto volume = expect_read(
        folder.write("a.nrrd", nrrd("type: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n"
                                    "spacings: 1 1 1\nunits: \"" +
                                        unit + "\" \"" + unit + "\" \"" + unit + "\"\n",
                                    phantom_bytes(ScalarType::u8, false))));
    EXPECT_EQ(volume_io::micrometres(volume.unit), 1) << unit;
  }
}

// As 3D Slicer writes sequences and MultiVolumes: the list runs fastest.
TEST(VolumeChoices, ListsOfSequencesAreTimes) {
  const Folder folder;
  const std::string header =
      "type: uint8\ndimension: 4\nspace: left-posterior-superior\nsizes: 2 2 2 2\n"
      "space directions: none (1,0,0) (0,1,0) (0,0,1)\nkinds: list domain domain domain\n"
      "encoding: raw\n";
  std::string data;
  for (int k = 0; k < 16; ++k) data += static_cast<char>(k);
  for (const char* sign : {"MultiVolume.NumberOfFrames:=2\n", "axis 0 index type:=numeric\n",
                           "labels: \"frame\" \"\" \"\" \"\"\n"}) {
    const auto path = folder.write("a.nrrd", nrrd(header + sign, data));
    EXPECT_EQ(value_at(expect_read(path, {.time = 1}), 1, 0, 0), 3) << sign;
    expect_error(path, ErrorCode::unsupported, "2 time points");
  }
  const auto path = folder.write("a.nrrd", nrrd(header, data));
  EXPECT_EQ(value_at(expect_read(path, {.component = 1}), 1, 0, 0), 3);
  for (const char* kind : {"vector", "none"}) {
    std::string other = header;
    other.replace(other.find("list"), 4, kind);
    const auto frames = nrrd(other + "MultiVolume.NumberOfFrames:=2\n", data);
    EXPECT_EQ(value_at(expect_read(folder.write("b.nrrd", frames), {.time = 1}), 1, 0, 0), 3);
  }
}

TEST(VolumeChoices, LargeRunsOfComponents) {
  const Folder folder;
  // A row of components is longer than what is read at once.
  const std::uint32_t width = 300'000;
  std::string data;
  for (const char c : {'a', 'b', 'c', 'd'})
    data += std::string(width, '\0') + std::string(width, c) + std::string(width, '\1');
  const auto header = "type: uchar\ndimension: 4\nsizes: " + std::to_string(width) +
                      " 3 2 2\nkinds: domain vector domain domain\nencoding: ";
  for (const bool packed : {false, true}) {
    const auto volume = expect_read(
        folder.write("a.nrrd",
                     nrrd(header + (packed ? "gzip\n" : "raw\n"), packed ? gzip(data) : data)),
        {.component = 1});
    EXPECT_EQ(value_at(volume, 5, 0, 0), 'a');
    EXPECT_EQ(value_at(volume, width - 1, 1, 1), 'd');
  }
}

// A qform counts where the sform is singular, even if its code is not set.
TEST(VolumeChoices, SingularSformsFallBackToTheQform) {
  const Folder folder;
  for (const int code : {0, 1}) {
    const auto volume =
        expect_read(folder.write("a.nii", nifti({.pixdim = {1, 1.5, 2, 3, 0, 0, 0, 0},
                                                 .qform = code,
                                                 .sform = 2,
                                                 .quaternion = {0, 0, 1, 20, -30, -10}})));
    EXPECT_EQ(volume.spacing(), glm::dvec3(1.5, 2, 3));
    EXPECT_EQ(volume.origin, glm::dvec3(-20, 30, -10));
    EXPECT_EQ(volume.placement, "qform (code " + std::to_string(code) + ")");
    EXPECT_THAT(volume.notes, ElementsAre(HasSubstr("its sform (code 2) is singular")));
  }
  expect_error(folder.write("b.nii", nifti({.sform = 2})), ErrorCode::bad_file,
               "spacing of axis 0 is 0");
}

// In every format, what the file states, right or wrong or not at all.
TEST(VolumeChoices, SpacingOverrulesTheFile) {
  const Folder folder;
  const VolumeOptions options{.spacing = glm::dvec3(1, 2, 3)};
  const auto expect = [&](const std::string& bytes) {
    const auto volume = expect_read(folder.write("a", bytes), options);
    EXPECT_LT(glm::length(volume.spacing() - glm::dvec3(1, 2, 3)), 1e-12);
    for (const auto& remark : volume.notes) EXPECT_EQ(remark.find("taken as 1"), std::string::npos);
    return volume;
  };
  expect(nifti({}));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double wrong : {0.0, -1.0, nan, HUGE_VAL}) {
    for (const int qform : {0, 1}) {
      const auto volume = expect(nifti(
          {.pixdim = {-1, 1, wrong, 1, 0, 0, 0, 0}, .qform = qform, .quaternion = {0, 0, 1}}));
      // A half turn about z, with the third axis reversed.
      if (qform) {
        EXPECT_LT(glm::length(volume.axes[2] - glm::dvec3(0, 0, -3)), 1e-12);
        EXPECT_LT(glm::length(volume.axes[0] - glm::dvec3(1, 0, 0)), 1e-12);
      }
    }
    // A column of the sform is lost: perpendicular to the others.
    Nifti header{.sform = 1};
    header.srow = phantom_srow();
    for (const std::size_t row : {2, 6, 10}) header.srow[row] = wrong == -1 ? 0 : wrong;
    const auto volume = expect(nifti(header));
    EXPECT_LT(glm::length(glm::abs(volume.axes[2]) - glm::dvec3(0, 0, 3)), 1e-6);
    EXPECT_LT(glm::length(volume.origin - phantom_origin()), 1e-5);
  }
  const std::string phantom = phantom_bytes(ScalarType::u8, false);
  const std::string lines = "type: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n";
  for (const auto* wrong :
       {"", "spacings: 1 0 1\n", "spacings: -1 nan inf\n", "axis mins: 1 1 1\naxis maxs: 1 1 1\n"})
    expect(nrrd(lines + wrong, phantom));
  const auto directed = expect(
      nrrd(lines + "space: LPS\nspace directions: (0,2,0) (0,0,0) (1,0,0)\nspace origin: (1,2,3)\n",
           phantom));
  EXPECT_EQ(directed.axes[0], glm::dvec3(0, 1, 0));
  EXPECT_EQ(directed.axes[1], glm::dvec3(0, 0, 2));
  EXPECT_EQ(directed.origin, glm::dvec3(1, 2, 3));
  for (const auto* wrong : {"", "ElementSpacing = 1 0 1\n", "ElementSpacing = 1 -2\n",
                            "ElementSpacing = a b c\n", "ElementSize = nan inf 0\n"}) {
    const auto volume = expect(
        "NDims = 3\nDimSize = 5 4 3\nElementType = MET_UCHAR\nTransformMatrix = 0 1 0 1 0 0 "
        "0 0 1\n" +
        std::string(wrong) + "ElementDataFile = LOCAL\n" + phantom);
    EXPECT_EQ(volume.axes[0], glm::dvec3(0, 1, 0));
  }
}

TEST(VolumeChoices, OneAxisWithoutSpacingIsSaidSo) {
  const Folder folder;
  const std::string phantom = phantom_bytes(ScalarType::u8, false);
  const auto read = [&](const std::string& more) {
    return expect_read(folder.write(
        "a.nrrd",
        nrrd("type: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n" + more, phantom)));
  };
  const auto partly = read("spacings: 0.5 0.5 nan\nthicknesses: nan nan 4\n");
  EXPECT_EQ(partly.spacing(), glm::dvec3(0.5, 0.5, 1));
  EXPECT_THAT(partly.notes, ElementsAre(AllOf(HasSubstr("no spacing along z: taken as 1"),
                                              HasSubstr("thickness"))));
  EXPECT_THAT(read("").notes, ElementsAre(HasSubstr("states no spacing")));
  EXPECT_THAT(read("spacings: 1 1 1\n").notes, IsEmpty());
  const auto meta = expect_read(folder.write(
      "a.mha",
      "NDims = 3\nDimSize = 5 4 3\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n" + phantom));
  EXPECT_THAT(meta.notes, ElementsAre(HasSubstr("states no spacing")));
}

// As in Teem: the ends of cells, unless centering says node.
TEST(VolumeChoices, NrrdSpacingFromTheEndsOfAxes) {
  const Folder folder;
  const auto read = [&](const std::string& more) {
    return expect_read(folder.write(
        "a.nrrd", nrrd("type: uchar\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n" + more,
                       phantom_bytes(ScalarType::u8, false))));
  };
  const std::string ends = "axis mins: 0 -8 10\naxis maxs: 7.5 0 4\n";
  const auto cells = read(ends);
  EXPECT_EQ(cells.axes, glm::dmat3(1.5, 0, 0, 0, 2, 0, 0, 0, -2));
  EXPECT_EQ(cells.origin, glm::dvec3(0.75, -7, 9));
  EXPECT_THAT(cells.notes, IsEmpty());
  const auto nodes = read("axis mins: 0 0 0\naxis maxs: 8 9 4\ncenterings: node node node\n");
  EXPECT_EQ(nodes.spacing(), glm::dvec3(2, 3, 2));
  EXPECT_EQ(nodes.origin, glm::dvec3(0));
  const auto mixed = read(
      "axis mins: 0 nan 0\naxis maxs: 8 6 6\nspacings: nan 1.5 nan\ncenters: node cell cell\n");
  EXPECT_EQ(mixed.spacing(), glm::dvec3(2, 1.5, 2));
  EXPECT_EQ(mixed.origin, glm::dvec3(0, 0.75, 1));
}

// The usual mistake: a layout of 8 bits for data of 16.
TEST(VolumeChoices, FilesThatGoOnAfterTheirVoxelsAreSaidSo) {
  const Folder folder;
  const std::string phantom = phantom_bytes(ScalarType::u8, false);
  const auto expect_note = [](const Volume& volume, const std::string& has,
                              const std::string& needs) {
    EXPECT_THAT(volume.notes, Contains(AllOf(HasSubstr("has " + has), HasSubstr("need " + needs))));
  };
  const RawLayout layout{.dims = kDims, .offset = 4};
  const auto raw = folder.write("a.raw", "head" + phantom + phantom);
  expect_note(expect_read(raw, {.raw = layout}), "124 bytes", "64");
  EXPECT_THAT(expect_read(raw, {.raw = layout, .time = 1}).notes, IsEmpty());
  EXPECT_THAT(expect_read(raw, {.raw = layout, .time = 0}).notes, IsEmpty());
  EXPECT_THAT(expect_read(folder.write("b.raw", phantom), {.raw = RawLayout{.dims = kDims}}).notes,
              IsEmpty());
  expect_note(expect_read(folder.write("a.nii", nifti({.qform = 1}) + "more")), "416 bytes", "412");
  const auto packed = expect_read(folder.write("a.nii.gz", gzip(nifti({.qform = 1}) + "more")));
  expect_note(packed, "416 unpacked bytes", "412");
  const std::string lines =
      "type: uchar\ndimension: 3\nsizes: 5 4 3\nspacings: 1 1 1\nencoding: raw\n";
  folder.write("d.raw", phantom + "more");
  expect_note(expect_read(folder.write("a.nhdr", nrrd(lines + "data file: d.raw\n", ""))),
              "64 bytes", "60");
  const std::string meta =
      "NDims = 3\nDimSize = 5 4 3\nElementSpacing = 1 1 1\n"
      "ElementType = MET_UCHAR\n";
  expect_note(expect_read(folder.write("a.mhd", meta + "ElementDataFile = d.raw\n")), "64 bytes",
              "60");
  EXPECT_THAT(
      expect_read(folder.write("b.mhd", meta + "HeaderSize = -1\nElementDataFile = d.raw\n")).notes,
      IsEmpty());
}

TEST(VolumeChoices, ArraysAreChosenWhereFilesNameThem) {
  const Folder folder;
  expect_error(folder.write("a.nii", nifti({})), ErrorCode::usage,
               "array 'b' was chosen, but files of this format name none", {.array = "b"});
}

}  // namespace
}  // namespace slf
