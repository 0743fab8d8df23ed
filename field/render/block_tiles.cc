#include "field/render/block_tiles.h"

namespace slf {

namespace {
constexpr std::size_t kReach = 8;  // bytes before `zeros` that a load may begin
}

BlockTiles::BlockTiles() { offsets_.zeros = zeros_.data() + kReach; }

void BlockTiles::look_up(const LevelGeometry& geometry, const PageTable& table, std::uint32_t frame,
                         bool with_depth, std::vector<TileKey>& touched) {
  with_depth_ = with_depth;
  any_absent_ = any_missing_ = false;
  offsets_.color.resize(tiles_.size() + 1);
  offsets_.depth.resize(tiles_.size() + 1);
  // Pages are mostly in no cache of the core's: all are fetched before any is read.
  for (Tile& tile : tiles_) {
    tile.page = table.find(tile.entry, tile.exit);
    __builtin_prefetch(tile.page);
  }
  for (std::uint32_t n = 0; n < tiles_.size(); ++n) {
    const Tile& tile = tiles_[n];
    const std::uint32_t layers = tile.page ? tile.page->layers.load(std::memory_order_acquire) : 0;
    if (!TilePage::readable(layers, with_depth)) {
      clear_page(n);
      any_absent_ = true;
      continue;
    }
    set_page(n, *tile.page, layers);
    if (tile.page->used.load(std::memory_order_relaxed) == frame) continue;
    tile.page->used.store(frame, std::memory_order_relaxed);
    touched.push_back(
        tile_key({geometry.entry_section(tile.entry), geometry.exit_section(tile.exit)}));
  }
}

void BlockTiles::set_page(std::uint32_t number, const TilePage& page) {
  set_page(number, page, page.layers.load(std::memory_order_acquire));
}

void BlockTiles::set_page(std::uint32_t number, const TilePage& page, std::uint32_t layers) {
  const bool missing = TilePage::missing(layers, with_depth_);
  tiles_[number].state = missing ? State::missing : State::available;
  any_missing_ |= missing;
  offsets_.color[number + 1] = offset_of(page.color.load(std::memory_order_acquire));
  if (with_depth_)
    offsets_.depth[number + 1] = offset_of(page.depth.load(std::memory_order_acquire));
}

std::int64_t BlockTiles::offset_of(const std::byte* samples) const {
  if (!samples) return 0;
  return static_cast<std::int64_t>(reinterpret_cast<std::uintptr_t>(samples) -
                                   reinterpret_cast<std::uintptr_t>(offsets_.zeros));
}

}  // namespace slf
