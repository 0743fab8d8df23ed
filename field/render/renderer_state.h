// What a Player shares with its Renderer: its state, and how a view loads what it needs, which
// drawing finds out. Private to field/render.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <set>
#include <vector>

#include "base/try.h"
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

/// Calls draw(), a view that does not wait and fills `statistics`, and load(misses), until nothing
/// is missed: depths in loaded tiles lead to further tiles. False: go_on() or load() is, or a tile
/// that was loaded is missed again, because it was evicted. Errors of draw() and load().
template <class Draw, class Load, class GoOn>
[[nodiscard]] Result<bool> load_misses(ViewStatistics& statistics, const Draw& draw,
                                       const Load& load, const GoOn& go_on) {
  std::set<TileKey> loaded;
  while (go_on()) {
    SLF_TRY(draw());
    const std::vector<TileKey>& misses = statistics.misses;
    if (misses.empty()) return true;
    if (std::ranges::any_of(misses, [&](TileKey key) { return loaded.contains(key); }))
      return false;
    const bool loads = SLF_TRY(load(misses));
    if (!loads) return false;
    loaded.insert(misses.begin(), misses.end());
  }
  return false;
}

}  // namespace slf
