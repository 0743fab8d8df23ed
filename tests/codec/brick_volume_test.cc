#include "codec/brick_volume.h"

#include <gtest/gtest.h>

#include <random>

namespace slf::codec {
namespace {

using Dims = std::array<std::uint32_t, 3>;

/// A ball with noise inside, so that some bricks are of one value.
Bytes ball(const Dims& dims) {
  std::mt19937 random(7);
  Bytes voxels;
  for (std::uint32_t z = 0; z < dims[2]; ++z)
    for (std::uint32_t y = 0; y < dims[1]; ++y)
      for (std::uint32_t x = 0; x < dims[0]; ++x) {
        const bool inside = x * x + y * y + z * z < 900;
        voxels.push_back(static_cast<std::byte>(inside ? 100 + x + random() % 8 : 0));
      }
  return voxels;
}

TEST(BrickVolume, DecodesWhatWasEncoded) {
  for (const Dims& dims : {Dims{1, 1, 1}, Dims{2, 3, 4}, Dims{33, 32, 31}, Dims{70, 40, 65}}) {
    const Bytes voxels = ball(dims);
    const auto one = encode_volume(dims, voxels, 0, 1), two = encode_volume(dims, voxels, 0, 2);
    ASSERT_TRUE(one && two);
    EXPECT_EQ(*one, *two);
    const auto back = decode_volume(dims, *one, 0, 2);
    ASSERT_TRUE(back) << back.error().message;
    EXPECT_EQ(*back, voxels);
  }
}

TEST(BrickVolume, ExtremesSurvive) {
  const Dims dims{34, 34, 3};
  Bytes voxels(34 * 34 * 3);
  std::mt19937 random(1);
  for (std::byte& voxel : voxels) voxel = static_cast<std::byte>(random() % 2 * 255);
  EXPECT_EQ(*decode_volume(dims, *encode_volume(dims, voxels, 0, 1), 0, 1), voxels);
}

TEST(BrickVolume, LossIsBoundedAndSavesBytes) {
  const Dims dims{70, 40, 65};
  const Bytes voxels = ball(dims);
  std::size_t before = encode_volume(dims, voxels, 0, 1)->size();
  for (const int loss : {1, 2, 5, 16}) {
    const Bytes code = *encode_volume(dims, voxels, loss, 1);
    EXPECT_LT(code.size(), before) << loss;
    before = code.size();
    const auto back = decode_volume(dims, code, loss, 1);
    ASSERT_TRUE(back) << back.error().message;
    for (std::size_t k = 0; k < voxels.size(); ++k)
      ASSERT_LE(std::abs(std::to_integer<int>((*back)[k]) - std::to_integer<int>(voxels[k])), loss);
  }
}

TEST(BrickVolume, BricksOfOneValueAreFree) {
  const Dims dims{128, 128, 128};
  const auto code = encode_volume(dims, Bytes(128 * 128 * 128, std::byte{9}), 0, 2);
  ASSERT_TRUE(code);
  EXPECT_LT(code->size(), 400u);
}

TEST(BrickVolume, DamageIsAnErrorOrOtherVoxels) {
  const Dims dims{40, 33, 35};
  const Bytes code = *encode_volume(dims, ball(dims), 0, 1);
  for (std::size_t size = 0; size < code.size(); size += 1 + size / 7)
    EXPECT_FALSE(decode_volume(dims, ByteSpan(code).first(size), 0, 1)) << size;
  for (std::size_t at = 0; at < code.size(); at += 1 + at / 7) {
    Bytes other = code;
    other[at] ^= std::byte{0x40};
    const auto decoded = decode_volume(dims, other, 0, 1);
    EXPECT_TRUE(decoded || decoded.error().code == ErrorCode::bad_file);
  }
  Bytes longer = code;
  longer.push_back(std::byte{0});
  EXPECT_FALSE(decode_volume(dims, longer, 0, 1));
}

}  // namespace
}  // namespace slf::codec
