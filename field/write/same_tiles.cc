#include "field/write/same_tiles.h"

#include <xxhash.h>

#include "base/try.h"

namespace slf {

namespace {
constexpr std::array<std::uint64_t, 2> kNoSamples{0, 1};
}  // namespace

Result<TileKey> SameTiles::find(const SourceTile& tile) {
  const TileKey key = tile.ref.key;
  if (hashes_.empty()) return key;
  const Hash own = remember(tile);
  for (std::uint64_t state = 0; own != kNoSamples && state < key.state; ++state) {
    const Hash other = SLF_TRY(hash_of(in_state(key, state)));
    if (other == own) return in_state(key, state);
  }
  return key;
}

SameTiles::Hash SameTiles::remember(const SourceTile& tile) {
  Hash hash = kNoSamples;
  if (tile.ref.state == TileState::stored) {
    const XXH128_hash_t found = XXH3_128bits(tile.samples.data(), tile.samples.size());
    hash = {found.low64 | 1, found.high64};
  }
  const std::lock_guard lock(mutex_);
  return this->hash(tile.ref.key) = hash;
}

Result<SameTiles::Hash> SameTiles::hash_of(TileKey key) {
  if (!tiles_.has(order_.number(key))) return kNoSamples;  // it is missing
  {
    const std::lock_guard lock(mutex_);
    if (const Hash& known = hash(key); known != Hash{}) return known;
  }
  SourceTile tile;
  SLF_TRY(source_.tile(key, tile));
  return remember(tile);
}

}  // namespace slf
