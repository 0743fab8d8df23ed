// What a build makes: its manifest, and how many rays it traces.
#pragma once

#include <cstdint>
#include <span>

#include "field/geometry/tile_order.h"
#include "field/geometry/tile_selection.h"
#include "field/manifest.h"
#include "field/write/tile_tracer.h"
#include "slf/build.h"

namespace slf {

/// The manifest of a new field. usage: a setting, or a scene's bounds or provenance, is invalid.
[[nodiscard]] Result<Manifest> plan_build(std::span<const FieldState> states,
                                          const BuildOptions& options);

/// The rays of some tiles, approximately.
[[nodiscard]] std::uint64_t count_rays(const TileTracer& tracer, const TileOrder& order,
                                       unsigned levels, const TileSelection& tiles);

}  // namespace slf
