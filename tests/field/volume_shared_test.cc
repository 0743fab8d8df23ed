// The volumes of shared/data, where they are there.
#include <gtest/gtest.h>

#include <filesystem>

#include "slf/transfer.h"
#include "slf/volume.h"

namespace slf {
namespace {

struct Known {
  const char* file;
  std::array<std::uint32_t, 3> dims;
  ScalarType type;
  glm::dvec3 spacing, origin;
  std::array<double, 2> range;
  glm::dvec3 signs;  // of the axes' diagonal: -1 where the grid runs against LPS
};

void PrintTo(const Known& known, std::ostream* out) { *out << known.file; }

class SharedVolume : public ::testing::TestWithParam<Known> {};

TEST_P(SharedVolume, IsReadInPlace) {
  const Known& known = GetParam();
  const std::string path = std::string(SLF_SHARED_DATA) + "/" + known.file;
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is not here";
  VolumeOptions options;
  if (path.ends_with(".den"))
    options.raw = RawLayout{.dims = known.dims, .spacing = known.spacing, .offset = 62};
  const auto volume = read_volume(path, options);
  ASSERT_TRUE(volume) << volume.error().message;
  EXPECT_EQ(volume->dims, known.dims);
  EXPECT_EQ(volume->type, known.type);
  const auto range = volume->value_range();
  EXPECT_NEAR(range[0], known.range[0], 1e-4 * std::abs(known.range[0]));
  EXPECT_NEAR(range[1], known.range[1], 1e-4 * std::abs(known.range[1]));
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(volume->axes[i][i], known.signs[i] * known.spacing[i], 1e-5);
    EXPECT_NEAR(volume->origin[i], known.origin[i], 1e-3);
  }
  // The default function clears the background and shows something of the rest.
  const auto transfer = default_transfer(*volume);
  EXPECT_EQ(transfer(range[0]).w, 0);
  EXPECT_GT(transfer(range[1]).w, 0.5);
}

const glm::dvec3 kAlong(1, 1, 1), kRas(-1, -1, 1);

INSTANTIATE_TEST_SUITE_P(
    All, SharedVolume,
    ::testing::Values(Known{"cranium_ct/cranium_ct_256x256x108_int16.nrrd",
                            {256, 256, 108},
                            ScalarType::i16,
                            {0.9570312, 0.9570312, 1.5},
                            {},
                            {-1024, 2986},
                            kAlong},
                      Known{"bonsai_ct/bonsai.nii.gz",
                            {256, 256, 256},
                            ScalarType::u8,
                            {1, 1, 1},
                            {127, 127, -128},
                            {0, 255},
                            kRas},
                      Known{"engine_ct/engine.nii.gz",
                            {256, 256, 128},
                            ScalarType::u8,
                            {1, 1, 1},
                            {127, 127, -64},
                            {0, 255},
                            kRas},
                      Known{"boston_teapot_ct/boston_teapot_256x256x178_uint8.nrrd",
                            {256, 256, 178},
                            ScalarType::u8,
                            {1, 1, 1},
                            {},
                            {0, 255},
                            kAlong},
                      Known{"tooth_ct/tooth.nhdr",
                            {103, 94, 161},
                            ScalarType::u16,
                            {1, 1, 1},
                            {},
                            {0, 1300},
                            kAlong},
                      Known{"brainsmall_mr/brainsmall.den",
                            {128, 128, 84},
                            ScalarType::u8,
                            {1, 1, 1.5},
                            {},
                            {0, 202},
                            kAlong},
                      Known{"headsq_ct_quarter/headsq_quarter_64x64x93_int16.nrrd",
                            {64, 64, 93},
                            ScalarType::i16,
                            {3.2, 3.2, 1.5},
                            {},
                            {0, 3926},
                            kAlong},
                      Known{"heptane_sim/heptane.nii.gz",
                            {302, 302, 302},
                            ScalarType::u8,
                            {1, 1, 1},
                            {150, 150, -151},
                            {0, 255},
                            kRas},
                      Known{"allen_brain_labels/AllenAtlas.nii.gz",
                            {318, 388, 310},
                            ScalarType::u8,
                            {0.5, 0.5, 0.5},
                            {79, 113, -72},
                            {0, 141},
                            kRas},
                      Known{"acrolein_density_sim/acrolein_scf_density_77x69x96_float32.nrrd",
                            {77, 69, 96},
                            ScalarType::f32,
                            {0.100954801, 0.100954801, 0.100954801},
                            {},
                            {3.4889e-24, 7.34741},
                            kAlong},
                      Known{"pet_dicom_headneck",
                            {128, 128, 299},
                            ScalarType::i16,
                            {3.537815, 3.537815, 3.375},
                            {-226.1322, -425.884, -1259.459},
                            {0, 66260.8},
                            kAlong}));

TEST(SharedVolume, AtlasLabelsEachHaveTheirColor) {
  const auto path = std::string(SLF_SHARED_DATA) + "/allen_brain_labels/AllenAtlas.nii.gz";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is not here";
  const auto volume = read_volume(path, {.raw = {}, .labels = true});
  ASSERT_TRUE(volume) << volume.error().message;
  const auto transfer = default_transfer(*volume);
  EXPECT_EQ(transfer.colors.size(), 139);  // 138 of the 141 ids occur, and 0
  EXPECT_EQ(transfer(0).w, 0);
  for (const auto& point : transfer.colors)
    EXPECT_EQ(transfer(point.value).w, point.value == 0 ? 0 : 1);
}

}  // namespace
}  // namespace slf
