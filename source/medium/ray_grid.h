// RayGrid: a volume with its transfer function, as rays and light see it. Private to source.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <span>
#include <vector>

#include "slf/transfer.h"
#include "slf/volume.h"
#include "source/medium/transfer_table.h"
#include "source/volume/voxels.h"

namespace slf {

/// A plane that clips the volume. Positions are in voxel indices.
struct GridPlane {
  glm::dvec3 inwards{0.0};  ///< unit, in voxel indices
  double offset = 0;
  glm::vec4 outwards{0};  ///< unit, world; padded

  /// How far a position lies on the side that is kept, in voxels.
  [[nodiscard]] double inside(const glm::dvec3& at) const { return glm::dot(inwards, at) + offset; }
  /// Limits the part [begin, end] of a ray to that side.
  void clip(const glm::dvec3& from, const glm::dvec3& direction, double& begin, double& end) const {
    const double at = inside(from), rate = glm::dot(inwards, direction);
    if (rate > 0)
      begin = std::max(begin, -at / rate);
    else if (at < 0 || rate < 0)
      end = std::min(end, rate < 0 ? -at / rate : begin);
  }
};

struct LightGrid;  // source/light/light_grid.h
struct PartRows;   // source/raycast/volume_parts.h

/// The inputs of the loop. Positions are in voxel indices.
struct RayGrid {
  const std::byte* voxels = nullptr;
  ScalarType type = ScalarType::u8;  ///< u8, i8, u16, i16 or f32
  bool labels = false;
  std::array<std::int32_t, 3> dims{};

  glm::dmat3 world_to_index{1.0};
  glm::dvec3 origin{0.0};
  /// Columns of the matrix that transforms gradients to world coordinates, padded to four.
  std::array<glm::vec4, 3> gradient_to_world{};
  std::array<glm::vec4, 3> index_to_world{};  ///< its columns, padded
  /// Unit, world: the normals of the volume's faces at its end along each axis. Faces cut matter,
  /// so they are surfaces.
  std::array<glm::vec4, 3> face_normals{};
  std::vector<GridPlane> clip;  ///< cut matter, too
  double unit = 1;              ///< of lengths: the smallest voxel spacing, in world units
  double step = 1;              ///< the longest interval of a ray that is one sample, in units

  /// Rays advance by cells, in which values are trilinear: the cubes between voxel centres. If each
  /// voxel has a label or a structure, they are split in half along each axis (cell_shift 1), so
  /// that a cell has one nearest voxel.
  int cell_shift = 0;
  std::array<std::int32_t, 3> cells{};

  TransferTable table;
  /// For volumes with structures: the row of the table that each voxel uses, and whether each row
  /// has any opacity. A sample uses the row of the nearest voxel.
  std::span<const std::uint8_t> rows;
  std::shared_ptr<const PartRows> parts;  ///< owns `rows`
  std::vector<std::uint8_t> visible_rows;
  /// Bricks are cubes of 2^brick_shift (whole) cells along an edge, or less at the end of the
  /// volume. In large volumes they are larger, so that there are few enough.
  int brick_shift = 1;
  std::array<std::int32_t, 3> bricks{};
  /// Per brick: Chebyshev distance, in bricks, to the nearest visible brick (0: this one is
  /// visible).
  std::vector<std::uint8_t> distance;
  /// Per brick, a bit for each of its octants, x fastest: whether any of its cells can be visible.
  std::vector<std::uint8_t> visible_octants;
  /// Cells outside this half-open box are invisible.
  glm::dvec3 visible_low{0.0};
  glm::dvec3 visible_high{0.0};

  Projection projection = Projection::none;

  /// If there is a light volume, it alone lights the samples.
  std::shared_ptr<LightGrid> light_volume;
  bool shade = true;
  glm::vec4 light{0};  ///< unit, towards the light; padded
  float ambient = 0.3f;
  float inverse_gradient_floor = 0;  ///< 1 / length; shading fades out for shorter gradients
};

/// with_type() of a grid's voxels, which have one of five types.
template <class Visitor>
decltype(auto) with_grid_type(ScalarType type, const Visitor& visitor) {
  return with_type(type, [&]<class T>(T voxel) -> decltype(auto) {
    if constexpr (sizeof(T) <= 2)
      return visitor(voxel);
    else
      return visitor(float{});
  });
}

}  // namespace slf
