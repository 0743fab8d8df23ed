// Small volumes and rigs for tests of light.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <glm/glm.hpp>
#include <vector>

#include "slf/raycaster.h"

namespace slf::samples {

/// A volume of bytes; one voxel is one world unit.
inline Volume volume_of(glm::uvec3 dims, const std::function<double(glm::ivec3)>& f) {
  Volume v;
  v.dims = {dims.x, dims.y, dims.z};
  v.source = "test";
  for (std::uint32_t z = 0; z < dims.z; ++z)
    for (std::uint32_t y = 0; y < dims.y; ++y)
      for (std::uint32_t x = 0; x < dims.x; ++x)
        v.voxels.push_back(static_cast<std::byte>(f(glm::ivec3(x, y, z))));
  return v;
}

inline Volume ball(int side) {
  return volume_of(glm::uvec3(side), [&](glm::ivec3 at) {
    const double r = glm::distance(glm::dvec3(at), glm::dvec3((side - 1) / 2.0));
    return std::clamp(128 + 40 * (0.35 * side - r), 0.0, 255.0);
  });
}

/// Opacity per world unit from `opacity`(value), one colour.
inline TransferFunction material(const glm::dvec3& srgb,
                                 std::vector<std::array<double, 2>> opacity) {
  TransferFunction t;
  t.colors = {{0, srgb}};
  for (const auto& [value, o] : opacity) t.opacities.push_back({value, o, 0.5, 0});
  return t;
}

/// No gradient anywhere: the same opacity at every value.
inline TransferFunction fog(const glm::dvec3& srgb, double opacity) {
  return material(srgb, {{0, opacity}});
}

inline RaycastOptions lit(const LightRig& rig, Lighting mode = Lighting::global) {
  RaycastOptions options;
  options.lighting.mode = mode;
  options.lighting.rig = rig;
  options.lighting.linear = true;
  options.lighting.bounces = 1000;
  options.lighting.spacing = 1;
  return options;
}

inline const LightRig kWhiteSky{"white sky", "", {}, {glm::vec3(1), glm::vec3(1), glm::vec3(1)}};

inline LightRig sun(const glm::dvec3& direction) { return {"sun", "", {{direction}}, {}}; }

}  // namespace slf::samples
