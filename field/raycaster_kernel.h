// The inner loop of the ray-caster, compiled for several instruction sets. Private to field/.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "field/scene.h"
#include "field/volume.h"

namespace slf {

/// Edge of a brick, in cells (the cubes between voxel centres); a power of two.
inline constexpr int kBrickShift = 2;
inline constexpr int kBrick = 1 << kBrickShift;

/// Colour and step-corrected opacity over the values of a volume.
struct TransferTable {
  /// How a value becomes an index: evenly over [low, high], or evenly over the bits of the float
  /// (constant relative precision), for functions whose points span many orders of magnitude.
  bool logarithmic = false;
  float low = 0;
  float scale = 1;           ///< entries per unit of value (even)
  std::int32_t low_key = 0;  /// ordered bits of `low` (logarithmic)
  int shift = 0;
  std::vector<glm::vec4> entries;  ///< straight RGB, opacity of one step
};

/// Everything the loop reads. Positions are in voxel indices.
struct RayGrid {
  const std::byte* voxels = nullptr;
  ScalarType type = ScalarType::u8;  ///< u8, i8, u16, i16 or f32
  bool labels = false;
  std::array<std::int32_t, 3> dims{};

  glm::dmat3 world_to_index{1.0};
  glm::dvec3 origin{0.0};
  /// Columns of the matrix that takes gradients to the world, padded to four.
  std::array<glm::vec4, 3> gradient_to_world{};
  double step = 1;  ///< world units

  TransferTable table;
  /// Per brick: Chebyshev distance, in bricks, to the nearest one with anything visible (0: this).
  std::vector<std::uint8_t> distance;
  std::array<std::int32_t, 3> bricks{};
  /// Cells outside this half-open box hold nothing visible.
  glm::dvec3 visible_low{0.0};
  glm::dvec3 visible_high{0.0};
  bool leap = true;

  bool shade = true;
  glm::vec4 light{0};  ///< unit, towards the light; padded
  float ambient = 0.3f;
  float inverse_gradient_floor = 0;  ///< 1 / length below which gradients fade to unshaded
};

/// Traces one ray; chooses the best instruction set at run time.
[[nodiscard]] RaySample trace_ray(const RayGrid& grid, const glm::dvec3& from,
                                  const glm::dvec3& to);

/// Index of a value in the table.
[[nodiscard]] std::int32_t ordered_bits(float value);

}  // namespace slf
