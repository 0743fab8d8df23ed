#include "field/write/same_tiles.h"

#include <xxhash.h>

#include "base/try.h"

namespace slf {

Result<std::uint64_t> SameTiles::find(const TracedTile& tile) {
  if (hashes_.empty()) return std::uint64_t{0};
  const Hash own = remember(tile);
  const std::uint64_t state = state_of(tile.key);
  for (std::uint64_t earlier = 0; !tile.empty && earlier < state; ++earlier) {
    const Hash other = SLF_TRY(hash_of(in_state(tile.key, earlier)));
    if (other == own) return state - earlier;
  }
  return std::uint64_t{0};
}

SameTiles::Hash SameTiles::remember(const TracedTile& tile) {
  const XXH128_hash_t found = XXH3_128bits(tile.samples.data(), tile.samples.size());
  const Hash hash = tile.empty ? Hash{0, 1} : Hash{found.low64 | 1, found.high64};
  const std::lock_guard lock(mutex_);
  return this->hash(tile.key) = hash;
}

Result<SameTiles::Hash> SameTiles::hash_of(TileKey key) {
  {
    const std::lock_guard lock(mutex_);
    if (const Hash& known = hash(key); known != Hash{}) return known;
  }
  TracedTile tile;
  SLF_TRY(tracer_.trace(key, tile));
  return remember(tile);
}

}  // namespace slf
