// What a Renderer holds; a Player shares its cache.
#pragma once

#include <cstdint>
#include <memory>

#include "field/field_file.h"
#include "field/render/tile_cache.h"
#include "slf/render.h"

namespace slf {

struct Renderer::State {
  Field field;
  unsigned threads;
  std::uint64_t pin_bytes;  // that each thread may pin
  std::shared_ptr<TileCache> cache;
};

}  // namespace slf
