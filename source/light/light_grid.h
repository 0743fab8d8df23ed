// The light volume that rays sample: a grid of what arrives at each node, in 12 bytes. Private to
// source.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "source/volume/voxels.h"

namespace slf {

/// What arrives at matter, as far as it varies slowly in space. Matter with the normal n, of which
/// the share s is a surface, scatters albedo × light_at(). What varies quickly, n, s and the
/// albedo, is left to rays.
struct ArrivingLight {
  glm::vec3 mean{0};     ///< from the surroundings and from matter, if s = 0
  glm::vec3 change{0};   ///< of the luminance of that with s n (world)
  glm::vec3 tint{0};     ///< the colour of the change; its length does not matter
  glm::vec3 arrives{0};  ///< the share of the light of each of the grid's lights

  ArrivingLight& operator+=(const ArrivingLight& other) {
    mean += other.mean, change += other.change, tint += other.tint, arrives += other.arrives;
    return *this;
  }
  friend ArrivingLight operator*(float factor, const ArrivingLight& l) {
    return {factor * l.mean, factor * l.change, factor * l.tint, factor * l.arrives};
  }
  friend ArrivingLight operator-(ArrivingLight a, const ArrivingLight& b) { return a += -1 * b; }
};

/// Luminance of linear RGB, Rec. 709.
inline constexpr glm::vec3 kLuminance{0.2126f, 0.7152f, 0.0722f};

/// A light of the rig, as rays see its middle. Padded for vectors.
struct GridLight {
  glm::vec4 irradiance{0};  ///< at the centre of the scene
  glm::vec4 direction{0};   ///< unit, world, to the light
  glm::vec4 place{0};       ///< of a near light: world, from the grid's origin
  float distance = 0;       ///< from the centre, world units; 0: infinitely far
};
/// Further lights of a rig count as surroundings.
inline constexpr std::size_t kGridLights = 3;

/// The nodes that were looked up before they were computed. Thread-safety: any thread, except
/// take().
class MissedNodes {
 public:
  explicit MissedNodes(std::size_t nodes) : marks_(nodes) {}
  void add(std::size_t number) {
    set(marks_[number]);
    set(any_);
  }
  [[nodiscard]] bool any() const {
    return std::atomic_ref(any_).load(std::memory_order_relaxed) != 0;
  }
  /// Returns and forgets them.
  [[nodiscard]] std::vector<std::size_t> take() {
    std::vector<std::size_t> numbers;
    for (std::size_t k = 0; any_ != 0 && k < marks_.size(); ++k)
      if (std::exchange(marks_[k], std::uint8_t{0}) != 0) numbers.push_back(k);
    any_ = 0;
    return numbers;
  }

 private:
  static void set(std::uint8_t& flag) {  // threads share what they only read
    const std::atomic_ref atomic(flag);
    if (atomic.load(std::memory_order_relaxed) == 0) atomic.store(1, std::memory_order_relaxed);
  }

  std::vector<std::uint8_t> marks_;
  mutable std::uint8_t any_ = 0;
};

/// Node (i, j, k), x fastest, is at the voxel index low + spacing·(i, j, k). Between nodes, light
/// is interpolated trilinearly.
struct LightGrid {
  std::array<std::int32_t, 3> dims{};
  glm::dvec3 low{0.0};
  double spacing = 1;               ///< voxels
  std::vector<GridLight> lights;    ///< at most kGridLights
  std::vector<std::uint8_t> nodes;  ///< node_bytes(); empty: no light volume
  /// Receives the nodes with the exponent kMissingNode that are looked up; null: there are none.
  MissedNodes* missed = nullptr;

  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(dims[0]) * dims[1] * dims[2];
  }
  /// Bytes of a node, and behind the last one, for loads of whole vectors.
  static constexpr std::size_t kNodeBytes = 12, kPadding = 8;
  [[nodiscard]] std::size_t node_bytes() const { return size() * kNodeBytes + kPadding; }
  /// The bytes of a node by its number.
  [[nodiscard]] const std::uint8_t* node(std::size_t number) const {
    return nodes.data() + kNodeBytes * number;
  }
  [[nodiscard]] std::uint8_t* node(std::size_t number) {
    return nodes.data() + kNodeBytes * number;
  }
};

/// Rays look up the light of matter beside it, on the side of its normal, at most this share of the
/// spacing away: the more of it is a surface, the further. There, in front of a wall, are the nodes
/// that stand for this side of it.
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
        f(number_in(light.dims, to), offset);
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

/// The bytes of a node: three of `mean` and three of `change`, which share an exponent; three of
/// `arrives`; red and blue of `tint` at a luminance of 1; and the exponent. All are 0 if the node
/// is dark. pack_light() and decode_light() make the exponent 0 to kExponents; it is kMissingNode
/// until the node is computed.
inline constexpr int kExponents = 32;  // byte 11 is 1 to 32: a unit of mean is 2^(byte - 24)
inline constexpr int kMissingNode = kExponents + 1;
inline constexpr int kChannels = 11;
inline constexpr float kMaxArrives = 1.25f, kMinTint = -1, kMaxTint = 2;

/// Byte c of a node counts kNodeUnits[exponent][c] × (byte - kNodeZeros[c]). Padded for vectors.
alignas(64) inline constexpr std::array<std::int32_t, 16> kNodeZeros{0, 0, 0, 128, 128, 128,
                                                                     0, 0, 0, 85,  85};
struct alignas(64) NodeUnits : std::array<float, 16> {};
inline const std::array<NodeUnits, kMissingNode + 1> kNodeUnits = [] {
  std::array<NodeUnits, kMissingNode + 1> units{};
  for (int e = 1; e <= kExponents; ++e)
    for (std::size_t c = 0; c < kChannels; ++c)
      units[static_cast<std::size_t>(e)][c] =
          c < 6 ? std::ldexp(c < 3 ? 1.f : 2.f, e - 24)
                : (c < 9 ? kMaxArrives : kMaxTint - kMinTint) / 255;
  units[kMissingNode].fill(std::numeric_limits<float>::quiet_NaN());
  return units;
}();

/// The colour with a luminance of 1; grey if it has none.
[[nodiscard]] inline glm::vec3 with_unit_luminance(const glm::vec3& color) {
  const float luminance = glm::dot(kLuminance, color);
  return std::abs(luminance) > 1e-20f ? color / luminance : glm::vec3(1);
}

/// Rounded to nearest; `mean` is cut off at 65280. REQUIRES: finite; mean and arrives not negative.
inline void pack_light(const ArrivingLight& light, std::uint8_t* node) {
  const glm::vec3 turn = glm::abs(light.change);
  const float most = std::max({light.mean.r, light.mean.g, light.mean.b,
                               std::max({turn.x, turn.y, turn.z}) * (255.f / 254)});
  int exponent = 0;
  std::frexp(most / 255, &exponent);  // most <= 255 · 2^exponent
  const int code = std::clamp(exponent + 24, 1, kExponents);
  const NodeUnits& units = kNodeUnits[static_cast<std::size_t>(code)];
  const glm::vec3 tint = with_unit_luminance(light.tint);
  const std::array<float, kChannels> values{light.mean.r,    light.mean.g,    light.mean.b,
                                            light.change.x,  light.change.y,  light.change.z,
                                            light.arrives.x, light.arrives.y, light.arrives.z,
                                            tint.r,          tint.b};
  for (std::size_t c = 0; c < kChannels; ++c)
    node[c] = static_cast<std::uint8_t>(std::clamp(
        std::lround(values[c] / units[c] + static_cast<float>(kNodeZeros[c])), 0L, 255L));
  node[kChannels] = static_cast<std::uint8_t>(code);
}

[[nodiscard]] inline ArrivingLight unpack_light(const std::uint8_t* node) {
  const NodeUnits& units = kNodeUnits[node[kChannels]];
  const auto value = [&](std::size_t c) {
    return units[c] * static_cast<float>(node[c] - kNodeZeros[c]);
  };
  const float red = value(9), blue = value(10);
  return {{value(0), value(1), value(2)},
          {value(3), value(4), value(5)},
          {red, (1 - kLuminance.r * red - kLuminance.b * blue) / kLuminance.g, blue},
          {value(6), value(7), value(8)}};
}

/// The light at a position in nodes, clamped to the grid; nothing beside nodes that are dark. Not a
/// number beside nodes that were missed.
[[nodiscard]] inline std::optional<ArrivingLight> look_up(const LightGrid& light,
                                                          const glm::dvec3& at) {
  const glm::ivec3 last(light.dims[0] - 1, light.dims[1] - 1, light.dims[2] - 1);
  const glm::vec3 inside(glm::clamp(at, glm::dvec3(0), glm::dvec3(last)));
  const glm::ivec3 a(inside);
  const glm::vec3 w = inside - glm::vec3(a);
  ArrivingLight sum;
  for (int corner = 0; corner < 8; ++corner) {
    const glm::ivec3 step(corner & 1, corner >> 1 & 1, corner >> 2);
    const glm::ivec3 n = glm::min(a + step, last);
    const std::size_t number = number_in(light.dims, n);
    const std::uint8_t* node = light.node(number);
    if (node[kChannels] == 0) return std::nullopt;
    if (node[kChannels] == kMissingNode) light.missed->add(number);
    const glm::vec3 share = glm::mix(1.f - w, w, glm::vec3(step));
    sum += share.x * share.y * share.z * unpack_light(node);
  }
  return sum;
}

/// The light of the surroundings and of matter that matter scatters; `normal` is s n.
[[nodiscard]] inline glm::vec3 surrounding_light(const ArrivingLight& light,
                                                 const glm::vec3& normal) {
  return glm::max(light.mean + glm::dot(light.change, normal) * with_unit_luminance(light.tint),
                  0.f);
}

}  // namespace slf
