// The state of a Renderer. A Player shares its tiles.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "field/field_file.h"
#include "field/render/block_renderer.h"
#include "field/tiles/tile_cache.h"
#include "slf/render.h"

namespace slf {

struct Renderer::State {
  TileReader tiles;
  std::uint64_t pin_bytes;                                // of tiles that each thread may pin
  unsigned parts;                                         // of a picture: as many as threads, or 1
  std::vector<std::unique_ptr<BlockRenderer>> renderers;  // one for each thread, made on first use
};

}  // namespace slf
