// Analyze 7.5, and pairs of header and voxels, named by either.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::Contains;
using ::testing::HasSubstr;

/// An Analyze header: NIfTI's without its magic, and with what SPM stores after the orientation.
std::string analyze(const Nifti& n, const std::array<int, 3>& spm_origin = {}) {
  std::string header = nifti(n).substr(0, 348);
  header.replace(344, 4, 4, '\0');
  header.replace(252, 92, 92, '\0');
  for (std::size_t i = 0; i < 3; ++i) {
    const auto bytes =
        integer_bytes(static_cast<std::uint64_t>(spm_origin[i]), false, n.big_endian);
    header.replace(253 + 2 * i, 2, bytes.substr(n.big_endian ? 2 : 0, 2));
  }
  return header;
}

Nifti spaced() { return {.pixdim = {0, 1.5, 2, 3, 0, 0, 0, 0}, .vox_offset = 0}; }

std::string nifti_pair(ScalarType type) {
  return nifti({.type = type, .vox_offset = 0, .magic = "i"}).substr(0, 348);
}

TEST(VolumeAnalyze, EveryTypeAndByteOrder) {
  const Folder folder;
  struct Known {
    ScalarType type;
    int code;
  };
  for (const bool big : {false, true})
    for (const auto& [type, code] :
         {Known{ScalarType::u8, 2}, Known{ScalarType::i16, 4}, Known{ScalarType::i32, 8},
          Known{ScalarType::f32, 16}, Known{ScalarType::f64, 64}, Known{ScalarType::i8, 130},
          Known{ScalarType::u16, 132}, Known{ScalarType::u32, 136}}) {
      Nifti n = spaced();
      n.big_endian = big;
      n.type = type;
      n.datatype = code;
      const auto header = folder.write("a.hdr", analyze(n));
      const auto voxels = folder.write("a.img", phantom_bytes(type, big));
      for (const auto& path : {header, voxels}) {
        const auto volume = expect_read(path);
        expect_phantom(volume, type);
        EXPECT_THAT(volume.files, ::testing::UnorderedElementsAre(header, voxels));
      }
    }
}

// As nibabel places it: x to the left, centred.
TEST(VolumeAnalyze, PositionWithAndWithoutSpmsOrigin) {
  const Folder folder;
  folder.write("a.img", phantom_bytes(ScalarType::u8, false));
  const auto centred = expect_read(folder.write("a.hdr", analyze(spaced())));
  EXPECT_EQ(centred.spacing(), glm::dvec3(1.5, 2, 3));
  EXPECT_EQ(centred.axes[0], glm::dvec3(1.5, 0, 0));  // from right to left: LAS
  EXPECT_EQ(centred.axes[1], glm::dvec3(0, -2, 0));
  EXPECT_EQ(world_of(centred, 0, 0, 0) + world_of(centred, 4, 3, 2), glm::dvec3(0));
  EXPECT_THAT(centred.notes, Contains(HasSubstr("left and right may be swapped")));
  Nifti scaled = spaced();
  scaled.slope = 0.5;
  scaled.intercept = 77;  // not Analyze's
  const auto placed = expect_read(folder.write("a.hdr", analyze(scaled, {2, 3, 1})));
  EXPECT_EQ(world_of(placed, 1, 2, 0), glm::dvec3(0));
  EXPECT_EQ(placed.placement, "pixdim and SPM's origin");
  EXPECT_EQ(value_at(placed, 0, 0, 0), 0.5);
}

TEST(VolumeAnalyze, PairsByEitherNameAndPacked) {
  for (const std::string packing : {"", ".gz"})
    for (const std::string other : {"", ".gz"}) {
      const Folder folder;
      const auto pack = [](const std::string& bytes, const std::string& how) {
        return how.empty() ? bytes : gzip(bytes);
      };
      const auto header =
          folder.write("p.hdr" + packing, pack(nifti_pair(ScalarType::i16), packing));
      const auto voxels =
          folder.write("p.img" + other, pack(phantom_bytes(ScalarType::i16, false), other));
      expect_phantom(expect_read(header), ScalarType::i16);
      expect_phantom(expect_read(voxels), ScalarType::i16);
    }
  const Folder capitals;
  capitals.write("A.HDR", nifti_pair(ScalarType::u8));
  expect_phantom(expect_read(capitals.write("A.IMG", phantom_bytes(ScalarType::u8, false))),
                 ScalarType::u8);
}

TEST(VolumeAnalyze, MissingHalvesAreNamed) {
  const Folder folder;
  expect_error(folder.write("a.hdr", analyze(spaced())), ErrorCode::not_found,
               folder.path("a.img"));
  expect_error(folder.write("b.hdr.gz", gzip(nifti_pair(ScalarType::u8))), ErrorCode::not_found,
               folder.path("b.img") + ": no such file");
  expect_error(folder.write("c.img", phantom_bytes(ScalarType::u8, false)), ErrorCode::usage,
               "whose header is missing (" + folder.path("c.hdr"));
  expect_error(folder.write("d.hdr", "no header"), ErrorCode::bad_file, "a header of NIfTI");
}

TEST(VolumeAnalyze, TruncatedAnywhereIsAnError) {
  const Folder folder;
  const std::string header = analyze(spaced()), voxels = phantom_bytes(ScalarType::u8, false);
  folder.write("a.img", voxels);
  for (std::size_t length = 0; length < header.size(); ++length)
    ASSERT_FALSE(read_volume(folder.write("a.hdr", header.substr(0, length)))) << length;
  const auto path = folder.write("a.hdr", header);
  for (std::size_t length = 0; length < voxels.size(); ++length) {
    folder.write("a.img", voxels.substr(0, length));
    ASSERT_FALSE(read_volume(path)) << length;
  }
}

}  // namespace
}  // namespace slf
