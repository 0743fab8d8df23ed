// A volume's content is one text: equal for equal voxels in equal places, and for nothing else.
#include "source/volume/content.h"

#include <gtest/gtest.h>

#include <set>

namespace slf {
namespace {

Volume example_volume() {
  Volume volume;
  volume.dims = {2, 3, 4};
  volume.voxels.resize(24);
  for (std::size_t k = 0; k < 24; ++k) volume.voxels[k] = static_cast<std::byte>(k * k);
  volume.source = "a.nii";
  volume.files = {"a.nii"};
  return volume;
}

TEST(VolumeContent, DependsOnEverythingButThePath) {
  Volume same = example_volume();
  same.source = "elsewhere/b.nrrd";
  same.files.clear();
  EXPECT_EQ(content_hash(same), content_hash(example_volume()));
  EXPECT_EQ(content_hash(same).size(), std::string("xxh3-128:").size() + 32);

  std::set<std::string> hashes{content_hash(example_volume())};
  const auto expect_other = [&](const auto& change) {
    Volume other = example_volume();
    change(other);
    EXPECT_TRUE(hashes.insert(content_hash(other)).second);
  };
  expect_other([](Volume& v) { v.voxels[23] ^= std::byte{1}; });
  expect_other([](Volume& v) { std::swap(v.voxels[0], v.voxels[1]); });
  expect_other([](Volume& v) { v.dims = {3, 2, 4}; });
  expect_other([](Volume& v) { v.type = ScalarType::i8; });
  expect_other([](Volume& v) { v.slope = 2; });
  expect_other([](Volume& v) { v.intercept = 1e-9; });
  expect_other([](Volume& v) { v.origin.z = -1; });
  expect_other([](Volume& v) { v.axes[0][1] = 0.001; });
  expect_other([](Volume& v) { v.axes[2] = -v.axes[2]; });
  expect_other([](Volume& v) { v.labels = true; });
}

}  // namespace
}  // namespace slf
