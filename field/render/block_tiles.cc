#include "field/render/block_tiles.h"

namespace slf {

namespace {
constexpr std::size_t kReach = 8;  // bytes before `zeros` that a load may begin
}

BlockTiles::BlockTiles() { offsets_.zeros = zeros_.data() + kReach; }

void BlockTiles::begin(const LevelGeometry& geometry, const PageTable& table, std::uint32_t frame,
                       bool with_depth, std::vector<TileKey>& touched) {
  geometry_ = &geometry;
  table_ = &table;
  frame_ = frame;
  with_depth_ = with_depth;
  touched_ = &touched;
  any_absent_ = any_missing_ = false;
  tiles_.clear();
  offsets_.color.resize(1);
  offsets_.depth.resize(1);
}

std::uint32_t BlockTiles::add(std::uint32_t entry, std::uint32_t exit) {
  const auto number = static_cast<std::uint32_t>(tiles_.size());
  TilePage* const page = table_->find(entry, exit);
  const std::uint32_t layers = page ? page->layers.load(std::memory_order_acquire) : 0;
  tiles_.push_back({entry, exit, State::absent});
  offsets_.color.push_back(0);
  offsets_.depth.push_back(0);
  if (!TilePage::readable(layers, with_depth_)) {
    any_absent_ = true;
    return number;
  }
  set_page(number, *page, layers);
  if (page->used.load(std::memory_order_relaxed) != frame_) {
    page->used.store(frame_, std::memory_order_relaxed);
    touched_->push_back(tile_key({geometry_->entry_section(entry), geometry_->exit_section(exit)}));
  }
  return number;
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
