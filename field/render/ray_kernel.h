// Where rays go: from a pixel to the cells of both lattices, on blocks of rays, compiled for
// several instruction sets. Private to field/.
//
// A ray's result depends on the ray alone, never on its place in a block: lanes do not mix.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>

#include "field/geometry/level_geometry.h"
#include "field/render/ray_block.h"

namespace slf {

/// The rays of a picture, in coordinates where the plenoptic sphere is the unit sphere: from the
/// eye through corner + (x + ½) across + (y + ½) down.
struct CameraBasis {
  glm::dvec3 eye{0.0}, corner{0.0}, across{0.0}, down{0.0};
  std::uint32_t width = 0;  ///< of the picture
};

/// A half-open rectangle of pixels.
struct PixelBlock {
  std::uint32_t x0, y0, x1, y1;
};

/// Casts a block's rays and keeps those that cross the sphere in front of the eye.
/// REQUIRES: `rays` is sized for all of them.
void cast_rays(const CameraBasis& basis, const PixelBlock& block, RayBlock& rays);

/// Finds the cell of the entry lattice each ray enters through and its rows; `nearest` keeps one
/// vertex.
void find_entries(const LevelGeometry& geometry, const RayBlock& rays, bool nearest,
                  bool with_points, EntryArrays& entries);

/// Finds the cell of the exit lattice, its section and columns, at each of `count` points.
void find_exits(const LevelGeometry& geometry, const PointArrays& points, std::size_t count,
                bool nearest, ExitArrays& exits);

/// Keeps the rays whose aims moved by more than `rest`, with the aims and `t`; find_entries() must
/// then find what else `entries` holds.
void keep_moving(float rest, RayBlock& rays, EntryArrays& entries, float* t);

/// Aims each ray's three entry vertices at what the ray sees at their depths t: where the lines
/// through it leave the sphere.
void aim_at_depth(const RayBlock& rays, const EntryArrays& entries,
                  std::array<PointArrays, 3>& aims);

}  // namespace slf
