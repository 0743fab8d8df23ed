// Casting and locating: computes the rays of a block's pixels, the cells of both lattices that they
// cross, and in depth refinement (depth_refinement.h) other lines to cross. Compiled for several
// instruction sets. Private to field/render.
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

/// Casts a block's rays and keeps those that cross the sphere in front of the eye. REQUIRES: at
/// most kBlockRays pixels.
void cast_rays(const CameraBasis& basis, const PixelBlock& block, RayBlock& rays);

/// Locates the cell of the entry lattice that each ray enters through: its vertices' sections, rows
/// and weights and, if `with_points`, their positions. If `nearest`, keeps only the nearest vertex.
void locate_entries(const LevelGeometry& geometry, const RayBlock& rays, bool nearest,
                    bool with_points, EntryCells& entries);

/// What a pass samples of an exit cell.
enum class ExitUse {
  nearest,  ///< the nearest vertex, which gets all of the weight
  all,      ///< its three vertices
  cubic,    ///< the vertices next to it, too
};

/// Locates the cell of the exit lattice at each of `count` points: its section, columns and
/// weights.
void locate_exits(const LevelGeometry& geometry, const PointArrays& points, std::size_t count,
                  ExitUse use, ExitCells& exits);

/// Compacts `rays` and `estimates` to the rays whose step exceeds `threshold`, and sets their aims
/// to those of the next round. Of the other rays, appends those with at least this contrast to
/// `contrast_rays` and `contrast_estimates`, with their last aims. The entry cells of all must then
/// be located again.
void separate_rays(float threshold, float contrast, RayBlock& rays, DepthEstimates& estimates,
                   RayBlock& contrast_rays, DepthEstimates& contrast_estimates);

/// Aims each entry vertex at the ray's point at the depth `estimates.aim`. Sets `exits` to the
/// points where the lines from the vertices through these points leave the sphere.
void aim_at_depth(const RayBlock& rays, const EntryCells& entries, const DepthEstimates& estimates,
                  std::array<PointArrays, 3>& exits);

}  // namespace slf
