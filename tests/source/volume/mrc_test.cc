// MRC maps with hand-made headers.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>

#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

struct Mrc {
  std::int32_t mode = 1;
  bool big = false;
  std::array<std::int32_t, 3> size{5, 4, 3}, start{}, intervals{5, 4, 3}, map{1, 2, 3};
  std::array<float, 3> cell{5, 8, 9}, angles{90, 90, 90}, origin{};
  std::int32_t space_group = 1, extended = 0;
  ScalarType type = ScalarType::i16;
  int volumes = 1;  ///< zeros, and the phantom last
};

std::string mrc(const Mrc& m) {
  std::string file(1024 + static_cast<std::size_t>(std::max(m.extended, 0)), '\0');
  const auto put = [&](std::size_t word, auto value) {
    std::uint32_t bits = 0;
    std::memcpy(&bits, &value, 4);
    file.replace(4 * (word - 1), 4, integer_bytes(bits, false, m.big));
  };
  for (std::size_t i = 0; i < 3; ++i) {
    put(1 + i, m.size[i]);
    put(5 + i, m.start[i]);
    put(8 + i, m.intervals[i]);
    put(11 + i, m.cell[i]);
    put(14 + i, m.angles[i]);
    put(17 + i, m.map[i]);
    put(50 + i, m.origin[i]);
  }
  put(4, m.mode);
  put(23, m.space_group);
  put(24, m.extended);
  file.replace(208, 4, "MAP ");
  for (int i = 1; i < m.volumes; ++i) file += std::string(60 * bytes_per_voxel(m.type), '\0');
  return file + phantom_bytes(m.type, m.big);
}

TEST(VolumeMrc, ReadsModesAndByteOrders) {
  const Folder folder;
  for (const bool big : {false, true})
    for (const auto& [mode, type] :
         {std::pair{0, ScalarType::i8}, std::pair{1, ScalarType::i16},
          std::pair{2, ScalarType::f32}, std::pair{6, ScalarType::u16}}) {
      const auto bytes = mrc({.mode = mode, .big = big, .extended = 80, .type = type});
      const auto volume = expect_read(folder.write("a.mrc", bytes));
      expect_phantom(volume, type);
      EXPECT_EQ(volume.spacing(), glm::dvec3(1, 2, 3));
      expect_phantom(expect_read(folder.write("a.map.gz", gzip(bytes))), type);
    }
}

TEST(VolumeMrc, HalfFloatsAndFourBits) {
  const Folder folder;
  for (const bool big : {false, true}) {
    std::string halves = mrc({.mode = 12, .big = big}).substr(0, 1024);
    // 0, 1, -2, the largest, the smallest above 0; the others 0.5.
    for (const unsigned bits : {0x0000u, 0x3c00u, 0xc000u, 0x7bffu, 0x0001u})
      halves += integer_bytes(bits, false, big).substr(big ? 2 : 0, 2);
    while (halves.size() < 1024 + 2 * 60)
      halves += integer_bytes(0x3800, false, big).substr(big ? 2 : 0, 2);
    const auto volume = expect_read(folder.write("a.mrc", halves));
    ASSERT_EQ(volume.type, ScalarType::f32);
    std::array<float, 6> values{};
    std::memcpy(values.data(), volume.voxels.data(), sizeof values);
    EXPECT_THAT(values, ElementsAre(0.F, 1.F, -2.F, 65504.F, 0x1p-24F, 0.5F));
    expect_error(folder.write("a.mrc", halves.substr(0, halves.size() - 1)), ErrorCode::bad_file,
                 "truncated");
  }
  // Rows of five take three bytes.
  std::string nibbles = mrc({.mode = 101}).substr(0, 1024);
  for (int row = 0; row < 12; ++row) nibbles += std::string("\x21\x43\xf5", 3);
  const auto volume = expect_read(folder.write("b.mrc", nibbles));
  ASSERT_EQ(volume.type, ScalarType::u8);
  ASSERT_EQ(volume.voxels.size(), 60u);
  for (std::size_t k = 0; k < 60; ++k)
    EXPECT_EQ(std::to_integer<std::size_t>(volume.voxels[k]), k % 5 + 1);
  expect_error(folder.write("b.mrc", nibbles.substr(0, nibbles.size() - 1)), ErrorCode::bad_file,
               "truncated");
}

TEST(VolumeMrc, CellAxesAndOrigin) {
  const Folder folder;
  // Columns along z, rows along x, sections along y: by the sizes of the cell.
  const auto turned = expect_read(folder.write(
      "a.mrc",
      mrc({.start = {1, 2, 3}, .intervals = {4, 3, 5}, .map = {3, 1, 2}, .cell = {8, 9, 5}})));
  EXPECT_EQ(turned.axes[0], glm::dvec3(0, 0, 1));
  EXPECT_EQ(turned.axes[1], glm::dvec3(2, 0, 0));
  EXPECT_EQ(turned.axes[2], glm::dvec3(0, 3, 0));
  EXPECT_EQ(turned.origin, glm::dvec3(4, 9, 1));
  const auto origin =
      expect_read(folder.write("b.mrc", mrc({.start = {1, 2, 3}, .origin = {7, 8, 9}})));
  EXPECT_EQ(origin.origin, glm::dvec3(7, 8, 9));
  const auto oblique = expect_read(folder.write("c.mrc", mrc({.angles = {90, 90, 120}})));
  EXPECT_NEAR(glm::dot(glm::normalize(oblique.axes[0]), glm::normalize(oblique.axes[1])), -0.5,
              1e-6);
  EXPECT_NEAR(oblique.spacing().y, 2, 1e-6);
  const auto bare = expect_read(folder.write("d.mrc", mrc({.cell = {0, 0, 0}})));
  EXPECT_EQ(bare.spacing(), glm::dvec3(1));
  EXPECT_EQ(bare.unit, "");
  EXPECT_EQ(oblique.unit, "Å");
  EXPECT_THAT(bare.notes, ElementsAre(HasSubstr("1x1x1")));
}

TEST(VolumeMrc, StacksAndErrors) {
  const Folder folder;
  const auto stack =
      folder.write("a.mrc", mrc({.size = {5, 4, 6}, .space_group = 401, .volumes = 2}));
  expect_error(stack, ErrorCode::unsupported, "2 time points");
  expect_phantom(expect_read(stack, {.time = 1}), ScalarType::i16);
  expect_error(folder.write("b.mrc", mrc({.mode = 4})), ErrorCode::unsupported, "complex");
  expect_error(folder.write("b.mrc", mrc({.mode = 77})), ErrorCode::bad_file, "mode is 77");
  expect_error(folder.write("b.mrc", mrc({.size = {50000, 50000, 50000}})), ErrorCode::bad_file,
               "need 250000000000000 bytes");
  expect_error(folder.write("b.mrc", mrc({.angles = {1, 1, 179}})), ErrorCode::bad_file,
               "singular");
  expect_error(folder.write("b.mrc", mrc({.extended = -1})), ErrorCode::bad_file,
               "extended header");
  const auto whole = mrc({});
  for (std::size_t size = 1; size < whole.size(); size += 13)
    EXPECT_FALSE(read_volume(folder.write("c.mrc", whole.substr(0, size)))) << size;
}

}  // namespace
}  // namespace slf
