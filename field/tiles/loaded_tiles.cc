#include "field/tiles/loaded_tiles.h"

namespace slf {

LoadedTile* LoadedTiles::find(TileKey key) const {
  const auto found = tiles_.find(key);
  return found == tiles_.end() ? nullptr : &*found->second;
}

LoadedTile& LoadedTiles::add(TileKey key, TilePage* page) {
  LoadedTile::List made(1);
  LoadedTile& tile = made.front();
  tile.key = key;
  tile.page = page ? page : &tile.unlisted;
  tile.place = made.begin();
  tiles_.emplace(key, tile.place);
  idle_.splice(idle_.end(), made);
  return tile;
}

void LoadedTiles::set_cost(LoadedTile& tile, std::uint64_t bytes) {
  bytes_ += bytes - tile.cost;
  if (tile.pins > 0) pinned_bytes_ += bytes - tile.cost;
  tile.cost = bytes;
}

void LoadedTiles::pin(LoadedTile& tile) {
  if (tile.pins++ > 0) return;
  pinned_.splice(pinned_.end(), idle_, tile.place);
  pinned_bytes_ += tile.cost;
}

void LoadedTiles::unpin(LoadedTile& tile, std::uint32_t now) {
  if (--tile.pins > 0) return;
  pinned_bytes_ -= tile.cost;
  idle_.splice(idle_.end(), pinned_, tile.place);
  if (tile.error) {
    remove(tile);
  } else {
    tile.listed = now;
    tile.page->used.store(now, std::memory_order_relaxed);
  }
  (void)remove_for(0);
}

LoadedTile* LoadedTiles::least_recently_used() {
  while (!idle_.empty()) {
    LoadedTile& tile = idle_.front();
    const std::uint32_t used = tile.page->used.load(std::memory_order_relaxed);
    if (used == tile.listed) return &tile;
    tile.listed = used;  // a frame has used it since
    idle_.splice(idle_.end(), idle_, tile.place);
  }
  return nullptr;
}

void LoadedTiles::remove(LoadedTile& tile) {
  tile.page->found.fetch_or(TilePage::kRemoved);
  tile.page->state.store(0, std::memory_order_release);
  tile.epoch = epochs_.end();
  removed_bytes_ += tile.cost;
  tiles_.erase(tile.key);
  removed_.splice(removed_.end(), idle_, tile.place);
}

bool LoadedTiles::remove_for(std::uint64_t bytes) {
  while (bytes_ - removed_bytes_ + bytes > budget_) {
    LoadedTile* const tile = least_recently_used();
    if (!tile) break;
    remove(*tile);
  }
  if (removed_.empty()) return false;
  const std::uint64_t freed = epochs_.freed();
  while (!removed_.empty() && removed_.front().epoch <= freed) {
    removed_bytes_ -= removed_.front().cost;
    bytes_ -= removed_.front().cost;
    garbage_.splice(garbage_.end(), removed_, removed_.begin());
  }
  return !removed_.empty() && bytes_ + bytes > budget_;
}

void LoadedTiles::clear_stamps() {
  for (const auto& [key, tile] : tiles_) tile->page->found.fetch_and(~TilePage::kStampMask);
}

}  // namespace slf
