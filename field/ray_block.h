// RayBlock: the rays of a block of pixels on their way through the renderer. Private to field/.
//
// Everything is a structure of arrays, so that the kernel takes as many rays at a time as the
// machine has lanes. Arrays are longer than the block by kRayPadding: the kernel works in whole
// vectors, and what it leaves behind the last ray means nothing.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

namespace slf {

/// At least the lanes of any target.
inline constexpr std::size_t kRayPadding = 64;

/// Points on (or in) the unit sphere.
struct PointArrays {
  std::vector<float> x, y, z;

  void resize(std::size_t size) {
    for (auto* axis : {&x, &y, &z}) axis->resize(size);
  }
};

/// Rays that cross the plenoptic sphere, in coordinates where that is the unit sphere around the
/// origin.
struct RayBlock {
  std::size_t count = 0;
  PointArrays enter, leave;
  std::vector<std::uint32_t> pixel;  ///< index in the picture

  void resize(std::size_t size) {
    enter.resize(size + kRayPadding);
    leave.resize(size + kRayPadding);
    pixel.resize(size + kRayPadding);
  }
};

/// Each ray's entry vertices: three, or in slot 0 the nearest alone.
struct EntryArrays {
  std::array<std::vector<std::uint32_t>, 3> index;  ///< in LevelGeometry::entry_rows()
  std::array<std::vector<float>, 3> weight;
  std::array<PointArrays, 3> point;  ///< the vertices, where depth is wanted

  void resize(std::size_t size) {
    for (auto& array : index) array.resize(size + kRayPadding);
    for (auto& array : weight) array.resize(size + kRayPadding);
    for (auto& points : point) points.resize(size + kRayPadding);
  }
};

/// The exit vertices around one exit point per ray: three, or in slot 0 the nearest alone.
struct ExitArrays {
  std::vector<std::uint32_t> section;
  std::array<std::vector<std::uint32_t>, 3> column;
  std::array<std::vector<float>, 3> weight;

  void resize(std::size_t size) {
    section.resize(size + kRayPadding);
    for (auto& array : column) array.resize(size + kRayPadding);
    for (auto& array : weight) array.resize(size + kRayPadding);
  }
};

/// The samples of each ray, as stored: [3 × entry slot + exit slot]. Only one of the two kinds of
/// colour is used.
struct SampleArrays {
  std::array<std::vector<std::uint32_t>, 9> rgba8;  ///< r in the lowest byte
  std::array<std::vector<glm::vec4>, 9> rgba16f;
  std::array<std::vector<std::uint8_t>, 9> depth;
};

/// A pass over rays: every ray's entry vertices, each aimed at an exit point.
struct Pass {
  unsigned entries = 3;  ///< slots in use
  unsigned exits = 3;
  bool with_depth = false;
  std::array<const PointArrays*, 3> aim{};  ///< per entry slot
  std::array<const ExitArrays*, 3> exit{};
};

}  // namespace slf
