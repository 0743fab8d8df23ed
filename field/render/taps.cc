#include "field/render/taps.h"

#include <algorithm>
#include <utility>

#include "field/render/sample_kernel.h"

namespace slf {
namespace {

constexpr std::uint64_t kPinBytes = 512;  // bookkeeping of a pinned tile, about
constexpr std::size_t kManyTiles = 4096;  // that a list may repeat

}  // namespace

void sort_unique(std::vector<TileKey>& keys) {
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
}

TapGatherer::TapGatherer(const FieldFile& field, TileCache& cache, std::uint64_t pin_bytes,
                         bool with_depth, bool wait, KeptTiles earlier)
    : cache_(cache),
      format_(field.manifest().layers[field.layer("color").value()].format),
      with_depth_(with_depth),
      wait_(wait),
      earlier_(std::move(earlier)) {
  const std::uint64_t sample = codec::sample_bytes(format_) + (with_depth ? 1 : 0);
  const std::uint64_t tile = field.shape().largest_tile() * sample + kPinBytes;
  // What is in the cache already takes no room when it is pinned.
  if (!wait) pin_bytes = kUnlimited;
  most_pins_ = static_cast<std::uint32_t>(std::clamp<std::uint64_t>(pin_bytes / tile, 1, 1 << 30));
  offsets_.zeros = zeros_.data() + TileCache::kBefore;
  if (earlier_.with_depth != with_depth) release(earlier_.tiles);
}

TapGatherer::~TapGatherer() {
  forget_tiles();
  release(earlier_.tiles);
}

KeptTiles TapGatherer::keep() && {
  KeptTiles kept;
  kept.numbers = std::move(numbers_);
  kept.tiles = std::move(tiles_);
  kept.with_depth = with_depth_;
  return kept;
}

void TapGatherer::resize(std::size_t rays) {
  for (auto& taps : taps_) taps.resize(rays + kRayPadding);
  samples_.resize(rays, half_floats());
  missing_.resize(rays);
}

void TapGatherer::release(std::span<Tile> tiles) {
  std::vector<TileCache::Pin> pins;
  for (Tile& tile : tiles)
    if (tile.pin) pins.push_back(std::move(tile.pin));
  if (!pins.empty()) cache_.release(pins);
}

void TapGatherer::forget_tiles() {
  // Tiles that are forgotten again and again are touched as often.
  if (touched_.size() > 2 * touched_once_ + kManyTiles) {
    sort_unique(touched_);
    touched_once_ = touched_.size();
  }
  release(tiles_);
  numbers_.clear();
  tiles_.clear();
  lacks_tiles_ = false;
  pinned_ = 0;
}

/// Follows the numbers given out.
void TapGatherer::add_tiles() {
  for (std::size_t n = tiles_.size(); n < numbers_.pairs().size(); ++n) {
    const auto [entry, exit] = numbers_.pairs()[n];
    touched_.push_back(tile_key({geometry_->entry_section(entry), geometry_->exit_section(exit)}));
    tiles_.push_back({touched_.back(), {}, false});
  }
  offsets_.color.resize(tiles_.size() + 1);
  offsets_.depth.resize(tiles_.size() + 1);
}

Result<void> TapGatherer::pin(Wave wave) {
  if (wave.begin == wave.end) return {};
  const std::vector<std::uint32_t> absent = find(wave);
  if (wait_) {
    if (auto ok = load(absent); !ok) return ok;
  } else {
    for (const std::uint32_t n : absent) {
      tiles_[n].missing = true;
      wanted_.push_back(tiles_[n].key);
    }
  }
  for (std::uint32_t n = wave.begin; n < wave.end; ++n) {
    const Tile& tile = tiles_[n];
    lacks_tiles_ |= tile.missing;
    offsets_.color[n + 1] = tile.pin ? offset_of(tile.pin.color()) : 0;
    offsets_.depth[n + 1] = tile.pin && with_depth_ ? offset_of(tile.pin.depth()) : 0;
  }
  return {};
}

std::vector<std::uint32_t> TapGatherer::find(Wave wave) {
  std::vector<TileKey> keys;
  std::vector<std::uint32_t> numbers, absent;
  for (std::uint32_t n = wave.begin; n < wave.end; ++n) {
    const std::uint32_t before = earlier_.numbers.known(numbers_.pairs()[n]);
    if (before != kNoTile && earlier_.tiles[before].pin) {
      hold(n, std::move(earlier_.tiles[before].pin));
    } else {
      keys.push_back(tiles_[n].key);
      numbers.push_back(n);
    }
  }
  if (keys.empty()) return absent;
  auto pins = cache_.find(keys, with_depth_);
  for (std::size_t k = 0; k < keys.size(); ++k)
    if (pins[k])
      hold(numbers[k], std::move(pins[k]));
    else
      absent.push_back(numbers[k]);
  return absent;
}

Result<void> TapGatherer::load(std::span<const std::uint32_t> numbers) {
  if (numbers.empty()) return {};
  std::vector<TileKey> keys;
  for (const std::uint32_t n : numbers) keys.push_back(tiles_[n].key);
  const auto located = cache_.locate(keys, with_depth_);
  for (std::size_t k = 0; k < numbers.size(); ++k) {
    auto pin = cache_.get(located[k], with_depth_);
    if (!pin) return tl::unexpected(pin.error());
    hold(numbers[k], std::move(*pin));
  }
  return {};
}

void TapGatherer::hold(std::uint32_t number, TileCache::Pin pin) {
  Tile& tile = tiles_[number];
  tile.pin = std::move(pin);
  tile.missing = tile.pin.missing(with_depth_);
}

std::int64_t TapGatherer::offset_of(const std::byte* samples) const {
  if (!samples) return 0;
  return static_cast<std::int64_t>(reinterpret_cast<std::uintptr_t>(samples) -
                                   reinterpret_cast<std::uintptr_t>(offsets_.zeros));
}

void TapGatherer::unpin(Wave wave) {
  for (std::uint32_t n = wave.begin; n < wave.end; ++n) {
    tiles_[n].pin = {};
    offsets_.color[n + 1] = offsets_.depth[n + 1] = 0;
  }
}

void TapGatherer::take(Wave wave, std::size_t count, const EntryArrays& entries, const Pass& pass,
                       bool add) {
  take_samples(offsets_, pass, entries, taps_, count, half_floats(), add, samples_);
  if (!lacks_tiles_) return;
  if (!any_missing_) std::fill_n(missing_.begin(), count, std::uint8_t{0});
  any_missing_ = true;
  for (std::size_t c = 0; c < pass.entries; ++c)
    for (std::size_t k = 0; k < count; ++k)
      if (const auto n = taps_[c][k]; n >= wave.begin && n < wave.end && tiles_[n].missing)
        missing_[k] = 1;
}

Result<void> TapGatherer::gather(const LevelGeometry& geometry, std::size_t count,
                                 const EntryArrays& entries, const Pass& pass) {
  if (geometry_ != &geometry || 2 * tiles_.size() > most_pins_) forget_tiles();
  geometry_ = &geometry;
  number_tiles(pass, entries, count, numbers_, taps_);
  add_tiles();
  const auto tiles = static_cast<std::uint32_t>(tiles_.size());
  if (tiles <= most_pins_) {
    if (auto ok = pin({pinned_, tiles}); !ok) return ok;
    pinned_ = tiles;
    take({0, tiles}, count, entries, pass, false);
    return {};
  }
  // Too many to hold at once: none of them stays.
  unpin({0, tiles});
  for (std::uint32_t begin = 0; begin < tiles; begin += most_pins_) {
    const Wave wave{begin, std::min(begin + most_pins_, tiles)};
    if (auto ok = pin(wave); !ok) return ok;
    take(wave, count, entries, pass, begin > 0);
    unpin(wave);
  }
  forget_tiles();
  return {};
}

}  // namespace slf
