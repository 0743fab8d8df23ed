// The light volume as rays look it up: a grid of colours in 32 bits each. Private to this room.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

namespace slf {

/// The light at node (i, j, k), x fastest, is that at the voxel index low + spacing·(i, j, k): what
/// the transfer function's colour is multiplied by to get radiance. Between nodes it is trilinear.
struct LightGrid {
  std::array<std::int32_t, 3> dims{};
  glm::dvec3 low{0.0};
  double spacing = 1;                ///< voxels
  std::vector<std::uint32_t> nodes;  ///< pack_light(); empty: no light volume

  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(dims[0]) * dims[1] * dims[2];
  }
};

/// RGB with 9 bits each and one exponent of 5 bits, as OpenGL's RGB9_E5: mantissa · 2^(e - 24).
/// Cut off at 65408; rounded to nearest. REQUIRES: not negative, finite.
[[nodiscard]] inline std::uint32_t pack_light(const glm::vec3& light) {
  const float most = std::min(std::max({light.r, light.g, light.b}), 65408.f);
  int exponent = 0;
  std::frexp(most, &exponent);  // most < 2^exponent
  int shared = std::clamp(exponent + 15, 0, 31);
  if (std::lround(std::ldexp(most, 24 - shared)) > 511) ++shared;  // rounded up to 512
  const auto mantissa = [&](float v) {
    return static_cast<std::uint32_t>(
        std::clamp(std::lround(std::ldexp(v, 24 - shared)), 0L, 511L));
  };
  return mantissa(light.r) | mantissa(light.g) << 9 | mantissa(light.b) << 18 |
         static_cast<std::uint32_t>(shared) << 27;
}

}  // namespace slf
