// The light volume that rays sample: a grid of colours in 32 bits each. Private to field/scene.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <vector>

namespace slf {

/// Node (i, j, k), x fastest, is at the voxel index low + spacing·(i, j, k). Its light is the
/// factor from the transfer function's colour to radiance. Between nodes it is interpolated
/// trilinearly.
struct LightGrid {
  std::array<std::int32_t, 3> dims{};
  glm::dvec3 low{0.0};
  double spacing = 1;                ///< voxels
  std::vector<std::uint32_t> nodes;  ///< pack_light(); empty: no light volume

  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(dims[0]) * dims[1] * dims[2];
  }
};

/// Rays look up the light of matter beside it, on the side of its normal, at most this share of the
/// spacing away: the more opaque a voxel of it is, the further. There, in front of a wall, are the
/// nodes that stand for this side of it.
inline constexpr float kLookUpBeside = 0.5f;

/// The place of a node by its number, its index in `nodes`.
[[nodiscard]] inline glm::ivec3 node_at(const LightGrid& light, std::size_t number) {
  const auto nx = static_cast<std::size_t>(light.dims[0]),
             ny = static_cast<std::size_t>(light.dims[1]);
  return {number % nx, number / nx % ny, number / (nx * ny)};
}

/// Calls f(number, offset) for the node itself and its neighbours in the grid.
template <class F>
void for_each_neighbour(const LightGrid& light, std::size_t number, const F& f) {
  const glm::ivec3 at = node_at(light, number);
  const glm::ivec3 dims(light.dims[0], light.dims[1], light.dims[2]);
  for (int z = -1; z <= 1; ++z)
    for (int y = -1; y <= 1; ++y)
      for (int x = -1; x <= 1; ++x) {
        const glm::ivec3 offset(x, y, z), to = at + offset;
        if (glm::any(glm::lessThan(to, glm::ivec3(0))) || glm::any(glm::greaterThanEqual(to, dims)))
          continue;
        f((static_cast<std::size_t>(to.z) * dims.y + to.y) * dims.x + to.x, offset);
      }
}

/// The number of a neighbour among the 27, x fastest; 13 is the node itself.
[[nodiscard]] inline std::size_t neighbour_number(const glm::ivec3& offset) {
  const int number = 13 + offset.x + 3 * offset.y + 9 * offset.z;
  return static_cast<std::size_t>(number);
}

/// Trilinear interpolation of one value per node at a position in nodes, clamped to the grid.
template <class T>
[[nodiscard]] float interpolate(const LightGrid& light, const std::vector<T>& values,
                                const glm::dvec3& at) {
  const glm::ivec3 last(light.dims[0] - 1, light.dims[1] - 1, light.dims[2] - 1);
  const glm::vec3 inside(glm::clamp(at, glm::dvec3(0), glm::dvec3(last)));
  const glm::ivec3 first = glm::min(glm::ivec3(inside), glm::max(last - 1, 0));
  const glm::ivec3 step = glm::min(glm::ivec3(1), last);
  const glm::vec3 w = inside - glm::vec3(first);
  const std::ptrdiff_t row = light.dims[0], slice = row * light.dims[1];
  const T* corner = values.data() + first.z * slice + first.y * row + first.x;
  const auto along = [&](std::ptrdiff_t offset) {
    return glm::mix(static_cast<float>(corner[offset]), static_cast<float>(corner[offset + step.x]),
                    w.x);
  };
  const std::ptrdiff_t up = step.y * row, back = step.z * slice;
  return glm::mix(glm::mix(along(0), along(up), w.y), glm::mix(along(back), along(back + up), w.y),
                  w.z);
}

/// RGB with 9 bits each and one exponent of 5 bits, as OpenGL's RGB9_E5: mantissa · 2^(e - 24).
/// Cut off at 65408; rounded to nearest. REQUIRES: not negative, finite.
[[nodiscard]] inline std::uint32_t pack_light(const glm::vec3& light) {
  const float max_channel = std::min(std::max({light.r, light.g, light.b}), 65408.f);
  int exponent = 0;
  std::frexp(max_channel, &exponent);  // max_channel < 2^exponent
  int shared = std::clamp(exponent + 15, 0, 31);
  if (std::lround(std::ldexp(max_channel, 24 - shared)) > 511) ++shared;  // rounded up to 512
  const auto mantissa = [&](float v) {
    return static_cast<std::uint32_t>(
        std::clamp(std::lround(std::ldexp(v, 24 - shared)), 0L, 511L));
  };
  return mantissa(light.r) | mantissa(light.g) << 9 | mantissa(light.b) << 18 |
         static_cast<std::uint32_t>(shared) << 27;
}

[[nodiscard]] inline glm::vec3 unpack_light(std::uint32_t packed) {
  const float unit = std::bit_cast<float>(((packed >> 27) + 127 - 24) << 23);  // 2^(e - 24)
  return unit * glm::vec3(packed & 511, packed >> 9 & 511, packed >> 18 & 511);
}

/// The light at a position in nodes, clamped to the grid; nothing beside nodes that are dark, among
/// which are those that were not computed.
[[nodiscard]] inline std::optional<glm::vec3> look_up(const LightGrid& light,
                                                      const glm::dvec3& at) {
  const glm::ivec3 last(light.dims[0] - 1, light.dims[1] - 1, light.dims[2] - 1);
  const glm::vec3 inside(glm::clamp(at, glm::dvec3(0), glm::dvec3(last)));
  const glm::ivec3 a(inside), b = glm::min(a + 1, last);
  const glm::vec3 w = inside - glm::vec3(a);
  bool dark = false;
  const auto node = [&](int x, int y, int z) {
    const std::uint32_t packed =
        light.nodes[(static_cast<std::size_t>(z) * light.dims[1] + y) * light.dims[0] + x];
    dark = dark || packed == 0;
    return unpack_light(packed);
  };
  const auto along = [&](int y, int z) { return glm::mix(node(a.x, y, z), node(b.x, y, z), w.x); };
  const glm::vec3 sum = glm::mix(glm::mix(along(a.y, a.z), along(b.y, a.z), w.y),
                                 glm::mix(along(a.y, b.z), along(b.y, b.z), w.y), w.z);
  return dark ? std::nullopt : std::optional(sum);
}

}  // namespace slf
