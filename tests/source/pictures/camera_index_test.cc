// The tree of cameras beside a search through all of them.
#include "source/pictures/camera_index.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

namespace slf {
namespace {

TEST(CameraIndex, FindsWhatComparingAllCamerasFinds) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> within(-1, 1);
  const auto anywhere = [&] { return glm::dvec3(within(random), within(random), within(random)); };
  for (const std::size_t count : {1, 7, 8, 9, 100, 3000}) {
    std::vector<glm::dvec3> eyes;
    std::vector<double> coarseness;
    for (std::size_t k = 0; k < count; ++k) {
      // On a sphere, or inside of it, or the same as another.
      eyes.push_back(k % 10 == 9  ? eyes[k / 2]
                     : k % 3 == 0 ? 3.0 * anywhere()
                                  : 3.0 * glm::normalize(anywhere()));
      coarseness.push_back(k % 5 == 0 ? 0.1 * std::abs(within(random)) : 0);
    }
    const CameraIndex index(eyes, coarseness);
    for (int ray = 0; ray < 200; ++ray) {
      const glm::dvec3 point = anywhere(), back = glm::normalize(anywhere());
      std::vector<CameraIndex::Near> all;
      for (std::size_t k = 0; k < count; ++k) {
        const glm::dvec3 toward = eyes[k] - point;
        const double cosine = glm::dot(toward, back) / glm::length(toward);
        all.push_back({std::sqrt(std::max(0.0, 2 - 2 * cosine)) + coarseness[k], k});
      }
      std::ranges::sort(all, std::less<>{});
      std::array<CameraIndex::Near, 16> found;
      ASSERT_EQ(index.nearest(point, back, found), std::min<std::size_t>(16, count));
      for (std::size_t k = 0; k < std::min<std::size_t>(16, count); ++k) {
        ASSERT_EQ(found[k].camera, all[k].camera) << count << " cameras, rank " << k;
        ASSERT_EQ(found[k].penalty, all[k].penalty);
      }
    }
  }
}

}  // namespace
}  // namespace slf
