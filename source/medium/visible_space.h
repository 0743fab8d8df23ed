// The visible parts of a volume: empty space to skip, and the bounds. Private to source.
#pragma once

#include <optional>

#include "slf/shape.h"
#include "source/medium/ray_grid.h"

namespace slf {

/// The most bricks of a grid, as of 512³ voxels: they take 6 bytes each, with those of Medium.
inline constexpr std::uint64_t kMaxBricks = std::uint64_t{1} << 24;

/// Computes the grid's bricks, distances and visible box from its table and dims, on `threads`
/// threads (0: all). Returns a sphere from the middle of that box to the farthest visible octant.
/// The sphere depends only on the volume, the table and `max_bricks`. Without a visible octant:
/// nothing, or, if it `may_be_empty`, as if the cell in the middle were visible. Throws
/// std::bad_alloc.
[[nodiscard]] std::optional<Sphere> find_visible_space(const Volume& volume, RayGrid& grid,
                                                       bool may_be_empty = false,
                                                       unsigned threads = 0,
                                                       std::uint64_t max_bricks = kMaxBricks);

/// A little more than the distance of a point to the farthest visible octant; 0 without one.
[[nodiscard]] double find_reach(const Volume& volume, const RayGrid& grid, const glm::dvec3& from);

}  // namespace slf
