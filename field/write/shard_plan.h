// ShardPlan: the tiles that one of several builds of a field makes.
//
// The positions of a field's tiles in key order are cut into ranges of equal work, counted in rays.
// The cuts depend on the settings alone, so builds on different machines agree on them, and the
// cuts of N ranges are among those of 2N: a range can be built as two halves. A shard has the tiles
// of all states at its positions, so the tiles that one equals or is predicted from are with it.
//
// A tile of a predictive codec is predicted from tiles of the next coarser level. A build that has
// no other file to read these from also makes all of them that it may need. It stores them in its
// file, but they do not belong to its part (doc/decisions/cluster.md).
#pragma once

#include "field/geometry/tile_order.h"
#include "field/geometry/tile_selection.h"
#include "field/write/tile_tracer.h"
#include "slf/build.h"
#include "slf/error.h"

namespace slf {

struct ShardPlan {
  TileRange part;       ///< the part of the field that the build is for
  TileSelection tiles;  ///< all tiles to build: the part, and those it is predicted from
};

/// `predicted`: tiles are predicted from tiles that the same build makes. usage: no such shard or
/// level.
[[nodiscard]] Result<ShardPlan> plan_shard(const TileTracer& tracer, const FieldShape& shape,
                                           const ShardOptions& options, bool predicted);

}  // namespace slf
