// Loading what a view needs: drawing finds that out. Private to field/render.
#pragma once

#include <algorithm>
#include <set>
#include <vector>

#include "base/try.h"
#include "slf/render.h"

namespace slf {

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
