#include "field/render/block_tiles.h"

namespace slf {

void BlockTiles::begin_view(unsigned state, bool with_depth, std::vector<TileKey>& touched) {
  state_ = state;
  with_depth_ = with_depth;
  touched_ = &touched;
}

void BlockTiles::begin_pass(std::uint32_t frame, const LevelGeometry& geometry,
                            const PageTable& table, bool wait) {
  frame_ = frame;
  stamp_ = TilePage::stamp(frame);
  geometry_ = &geometry;
  table_ = &table;
  wait_ = wait;
  any_unavailable_ = false;
  absent_.clear();
}

BlockTiles::Found BlockTiles::find(std::uint32_t entry, std::uint32_t exit) {
  TilePage* const page = table_->find(entry, exit);
  std::uint64_t word = page ? page->found.load(std::memory_order_acquire) : TilePage::kRemoved;
  const std::uint32_t state = page ? page->state.load(std::memory_order_acquire) : 0;
  const bool loaded = (state & TilePage::kLoaded) != 0;
  const bool before = page && page->used.load(std::memory_order_relaxed) == frame_;
  if (!(before && loaded) && !mark_used(entry, exit, page, loaded)) {
    any_unavailable_ |= !wait_;
    return {0, 0, !wait_};
  }
  Found found;
  found.unavailable = (state & TilePage::kMissing) != 0;
  any_unavailable_ |= found.unavailable;
  found.color = sample_offset(page->color.load(std::memory_order_acquire));
  if (with_depth_) found.depth = sample_offset(page->depth.load(std::memory_order_acquire));
  // Stamp the page, so that kernels find the tile, unless it was removed.
  if (!found.unavailable && (word & TilePage::kStampMask) != TilePage::kRemoved)
    page->found.compare_exchange_strong(word, (word & ~TilePage::kStampMask) | stamp_,
                                        std::memory_order_acq_rel);
  return found;
}

bool BlockTiles::mark_used(std::uint32_t entry, std::uint32_t exit, TilePage* page, bool loaded) {
  const TileKey key =
      in_state(tile_key({geometry_->entry_section(entry), geometry_->exit_section(exit)}), state_);
  if (!loaded) {
    std::uint32_t& recent = recent_[(5 * entry + exit) % kRecent];
    if (recent < absent_.size() && absent_[recent] == key) return false;
    recent = static_cast<std::uint32_t>(absent_.size());
    absent_.push_back(key);
    return false;
  }
  if (page->used.load(std::memory_order_relaxed) != frame_) {
    page->used.store(frame_, std::memory_order_relaxed);
    touched_->push_back(key);
  }
  return true;
}

}  // namespace slf
