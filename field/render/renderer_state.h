// What a Renderer holds; a Player shares its cache.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "field/field_file.h"
#include "field/render/block_renderer.h"
#include "field/render/tile_cache.h"
#include "slf/render.h"

namespace slf {

struct Renderer::State {
  Field field;
  unsigned threads;
  std::uint64_t pin_bytes;  // that each thread may pin
  bool keep;
  std::shared_ptr<TileCache> cache;
  std::vector<BlockRenderer::Kept> kept{};  // by band of the picture
};

}  // namespace slf
