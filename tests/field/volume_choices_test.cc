// Choices that all formats share: component, time, crop, spacing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "volume_samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::ElementsAre;

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

TEST(VolumeChoices, SpacingOverrulesTheFile) {
  const Folder folder;
  const auto volume =
      expect_read(folder.write("a.nii", nifti({})), {.spacing = glm::dvec3(1, 2, 3)});
  EXPECT_LT(glm::length(volume.spacing() - glm::dvec3(1, 2, 3)), 1e-12);
}

}  // namespace
}  // namespace slf
