// FreeSurfer's volumes: .mgh, and .mgz.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>

#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using namespace samples;
using ::testing::HasSubstr;

struct Mgh {
  int code = 0;
  ScalarType type = ScalarType::u8;
  std::uint64_t frames = 1;
  bool placed = true;
  std::string data = phantom_bytes(type, true);
};

std::string real(double value) {
  return integer_bytes(std::bit_cast<std::uint32_t>(static_cast<float>(value)), false, true);
}

/// The phantom in its place: the directions of the axes in RAS, and the centre of the volume.
std::string mgh(const Mgh& m) {
  const auto four = [](std::uint64_t value) { return integer_bytes(value, false, true); };
  std::string header = four(1);
  for (const auto extent : kDims) header += four(extent);
  header += four(m.frames) + four(static_cast<std::uint64_t>(m.code)) + four(0);
  header += std::string("\0", 1) + (m.placed ? '\1' : '\0');
  const auto axes = phantom_axes();
  glm::dvec3 centre = phantom_origin();
  for (int i = 0; i < 3; ++i) header += real(glm::length(axes[i]));
  for (int axis = 0; axis < 3; ++axis) {
    const auto direction = glm::normalize(axes[axis]) * glm::dvec3(-1, -1, 1);
    for (int i = 0; i < 3; ++i) header += real(direction[i]);
    centre += axes[axis] * (kDims[static_cast<std::size_t>(axis)] / 2.0);
  }
  for (int i = 0; i < 3; ++i) header += real(centre[i] * (i < 2 ? -1 : 1));
  header.resize(284, '\0');
  return header + m.data;
}

const std::array kTypes{Mgh{0, ScalarType::u8}, Mgh{1, ScalarType::i32}, Mgh{3, ScalarType::f32},
                        Mgh{4, ScalarType::i16}, Mgh{10, ScalarType::u16}};

TEST(VolumeMgh, EveryTypePlainAndPacked) {
  const Folder folder;
  for (const auto& sample : kTypes) {
    const std::string bytes = mgh(sample) + "trailing tags of FreeSurfer";
    expect_phantom(expect_read(folder.write("a.mgh", bytes)), sample.type);
    expect_phantom(expect_read(folder.write("a.mgz", gzip(bytes))), sample.type);
  }
}

TEST(VolumeMgh, PositionIsThatOfTheSameNifti) {
  const Folder folder;
  const auto volume = expect_read(folder.write("a.mgz", gzip(mgh({}))));
  for (const auto& [i, j, k] : {std::array{0u, 0u, 0u}, {4u, 0u, 0u}, {0u, 3u, 0u}, {1u, 2u, 2u}}) {
    const auto expected = phantom_origin() + phantom_axes() * glm::dvec3(i, j, k);
    EXPECT_LT(glm::length(world_of(volume, i, j, k) - expected), 1e-5) << i << j << k;
  }
  EXPECT_TRUE(volume.notes.empty());
  EXPECT_EQ(volume.unit, "mm");
}

TEST(VolumeMgh, WithoutPositionAsFreeSurferDoes) {
  const Folder folder;
  const auto volume = expect_read(folder.write("a.mgh", mgh({.placed = false})));
  // RAS: x to the left, y down, z to the front. LPS: x as it is, z to the back is negative.
  EXPECT_EQ(volume.axes,
            glm::dmat3(glm::dvec3(1, 0, 0), glm::dvec3(0, 0, -1), glm::dvec3(0, -1, 0)));
  EXPECT_EQ(volume.origin, glm::dvec3(-2.5, 1.5, 2));
  EXPECT_THAT(volume.notes, ::testing::ElementsAre(HasSubstr("no position")));
}

TEST(VolumeMgh, FramesAreTimePoints) {
  const Folder folder;
  const auto path = folder.write(
      "a.mgh",
      mgh({.frames = 2, .data = std::string(60, 'x') + phantom_bytes(ScalarType::u8, true)}));
  expect_error(path, ErrorCode::unsupported, "choose time point 0 to 1");
  expect_phantom(expect_read(path, {.time = 1}), ScalarType::u8);
}

TEST(VolumeMgh, TypesThatAreNotReadAreNamed) {
  const Folder folder;
  expect_error(folder.write("a.mgh", mgh({.code = 6})), ErrorCode::unsupported,
               "MGH voxels of type 6");
  expect_error(folder.write("b.mgh", "no header"), ErrorCode::bad_file, "an MGH header");
}

TEST(VolumeMgh, TruncatedAnywhereIsAnError) {
  const Folder folder;
  for (const auto& [file, bytes] : {std::pair{"a.mgh", mgh({})}, {"a.mgz", gzip(mgh({}))}})
    expect_cuts_refused(folder, file, bytes);
}

}  // namespace
}  // namespace slf
