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

#include "base/go_on.h"
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

/// usage: no such shard or level, or levels with more tiles than anybody builds.
[[nodiscard]] Result<void> check_shard(const FieldShape& shape, const ShardOptions& options);

/// `predicted`: tiles are predicted from tiles that the same build makes. cancelled: stopped by
/// `go_on`. REQUIRES: check_shard().
[[nodiscard]] Result<ShardPlan> plan_shard(const TileTracer& tracer, const FieldShape& shape,
                                           const ShardOptions& options, bool predicted,
                                           const GoOn& go_on);

/// Calls f for each number of a range. There may be billions: asks now and then whether to go on.
template <class F>
[[nodiscard]] Result<void> for_each_number(NumberRange range, const GoOn& go_on, const F& f) {
  constexpr std::uint64_t kAsks = 1 << 16;
  for (std::uint64_t n = range.begin; n < range.end; ++n) {
    if ((n - range.begin) % kAsks == kAsks - 1 && !go_on())
      return fail(ErrorCode::cancelled, "interrupted; nothing was written");
    f(n);
  }
  return {};
}

}  // namespace slf
