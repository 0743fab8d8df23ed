#include "field/render/sample_gatherer.h"

#include <algorithm>
#include <span>

#include "field/render/gather_kernel.h"

namespace slf {
namespace {

constexpr std::uint64_t kPinBytes = 512;  // bookkeeping of a pinned tile, about
constexpr std::size_t kManyKeys = 4096;   // that a list may repeat

TileKey key_of(const LevelGeometry& geometry, const BlockTiles::Tile& tile) {
  return tile_key({geometry.entry_section(tile.entry), geometry.exit_section(tile.exit)});
}

}  // namespace

void sort_unique(std::vector<TileKey>& keys) {
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
}

SampleGatherer::SampleGatherer(const FieldFile& field, TileCache& cache, std::uint64_t pin_bytes,
                               std::size_t most_rays)
    : cache_(cache),
      reader_(cache),
      format_(color_format(field.manifest().layers[field.layer("color").value()].format)),
      pin_bytes_(pin_bytes),
      largest_tile_(field.shape().largest_tile()) {
  for (auto& numbers : numbers_) numbers.resize(most_rays + kRayPadding);
  samples_.resize(most_rays, half_floats());
  unavailable_.resize(most_rays);
}

void SampleGatherer::begin(std::uint32_t frame, bool with_depth) {
  frame_ = frame;
  with_depth_ = with_depth;
  touched_.clear();
  wanted_.clear();
  wanted_once_ = 0;
}

Result<void> SampleGatherer::gather(const LevelGeometry& geometry, bool wait, std::size_t count,
                                    const EntryCells& entries, const Pass& pass) {
  tiles_.clear();
  number_tiles(pass, entries, count, tiles_, numbers_);
  bool load = false;
  {
    const TileCache::ReadScope scope(reader_);
    tiles_.look_up(geometry, cache_.page_table(geometry.level()), frame_, with_depth_, touched_);
    load = wait && tiles_.any_absent();
    if (!load)
      gather_samples(tiles_.offsets(), pass, entries, numbers_, count, half_floats(), false,
                     samples_);
  }
  if (load)
    if (auto ok = gather_in_batches(geometry, count, entries, pass); !ok) return ok;
  find_unavailable(geometry, wait, count, pass);
  return {};
}

Result<void> SampleGatherer::gather_in_batches(const LevelGeometry& geometry, std::size_t count,
                                               const EntryCells& entries, const Pass& pass) {
  // Tiles that were found are not safe any more, so all are loaded, in the order of their keys.
  std::vector<std::pair<TileKey, std::uint32_t>> numbers;
  for (std::uint32_t n = 0; n < tiles_.tiles().size(); ++n) {
    numbers.emplace_back(key_of(geometry, tiles_.tiles()[n]), n);
    tiles_.clear_page(n);
  }
  std::sort(numbers.begin(), numbers.end());
  std::vector<TileKey> keys;
  for (const auto& [key, number] : numbers) keys.push_back(key);
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
  touched_.insert(touched_.end(), keys.begin(), keys.end());

  const std::uint64_t sample = codec::sample_bytes(format_) + (with_depth_ ? 1 : 0);
  const std::size_t most =
      std::max<std::uint64_t>(pin_bytes_ / (largest_tile_ * sample + kPinBytes), 1);
  auto next = numbers.begin();
  for (std::size_t begin = 0; begin < keys.size(); begin += most) {
    const auto batch = std::span(keys).subspan(begin, std::min(most, keys.size() - begin));
    const auto pins = cache_.load(batch, with_depth_);
    if (!pins) return tl::unexpected(pins.error());
    const auto first = next;
    for (std::size_t k = 0; k < batch.size(); ++k)
      for (; next != numbers.end() && next->first == batch[k]; ++next)
        tiles_.set_page(next->second, (*pins)[k].page());
    gather_samples(tiles_.offsets(), pass, entries, numbers_, count, half_floats(), begin > 0,
                   samples_);
    for (auto at = first; at != next; ++at) tiles_.clear_offset(at->second);
  }
  return {};
}

void SampleGatherer::find_unavailable(const LevelGeometry& geometry, bool wait, std::size_t count,
                                      const Pass& pass) {
  any_unavailable_ = tiles_.any_missing() || (!wait && tiles_.any_absent());
  if (!any_unavailable_) return;
  std::fill_n(unavailable_.begin(), count, std::uint8_t{0});
  for (std::size_t c = 0; c < pass.entries; ++c)
    for (std::size_t k = 0; k < count; ++k)
      if (const auto n = numbers_[c][k];
          n != kNoTile && tiles_.tiles()[n].state != BlockTiles::State::available)
        unavailable_[k] = 1;
  if (wait) return;
  for (const BlockTiles::Tile& tile : tiles_.tiles())
    if (tile.state == BlockTiles::State::absent) wanted_.push_back(key_of(geometry, tile));
  if (wanted_.size() > 2 * wanted_once_ + kManyKeys) {
    sort_unique(wanted_);
    wanted_once_ = wanted_.size();
  }
}

}  // namespace slf
