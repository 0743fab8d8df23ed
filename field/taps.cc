#include "field/taps.h"

#include <Imath/half.h>

#include <algorithm>

namespace slf {
namespace {

constexpr std::uint32_t kNoTile = ~0u;
constexpr std::uint64_t kPinBytes = 512;  // bookkeeping of a pinned tile, about

void load(const std::byte* samples, std::size_t at, std::uint32_t& color) {
  color = load_le<std::uint32_t>(samples + 4 * at);
}

void load(const std::byte* samples, std::size_t at, glm::vec4& color) {
  for (int c = 0; c < 4; ++c) {
    Imath::half value;
    value.setBits(load_le<std::uint16_t>(samples + 8 * at + 2 * static_cast<std::size_t>(c)));
    color[c] = value;
  }
}

}  // namespace

TapGatherer::TapGatherer(const Field& field, TileCache& cache, std::uint64_t pin_bytes,
                         bool with_depth, bool wait)
    : cache_(cache),
      color_(field.layer("color").value_or(0)),
      depth_(with_depth ? field.layer("depth") : std::nullopt),
      format_(field.manifest().layers[color_].format),
      wait_(wait) {
  const std::uint64_t sample = codec::sample_bytes(format_) + (with_depth ? 1 : 0);
  const std::uint64_t tile = field.shape().largest_tile() * sample + kPinBytes;
  most_pins_ = static_cast<std::uint32_t>(std::clamp<std::uint64_t>(pin_bytes / tile, 1, 1 << 20));
  rehash(256);
}

void TapGatherer::resize(std::size_t rays) {
  for (auto& taps : taps_) taps.resize(rays);
  for (auto& depths : samples_.depth) depths.resize(rays + kRayPadding);
  for (auto& colors : samples_.rgba8) colors.resize(half_floats() ? 0 : rays + kRayPadding);
  for (auto& colors : samples_.rgba16f) colors.resize(half_floats() ? rays + kRayPadding : 0);
  missing_.resize(rays);
}

void TapGatherer::rehash(std::size_t slots) {
  slots_.assign(slots, kNoTile);
  for (std::uint32_t n = 0; n < tiles_.size(); ++n) {
    std::size_t slot = tiles_[n].sections * 0x9E3779B97F4A7C15u >> 32 & (slots - 1);
    while (slots_[slot] != kNoTile) slot = (slot + 1) & (slots - 1);
    slots_[slot] = n;
  }
}

void TapGatherer::forget_tiles() {
  tiles_.clear();
  pinned_ = 0;
  std::fill(slots_.begin(), slots_.end(), kNoTile);
}

std::uint32_t TapGatherer::number_of(std::uint64_t sections) {
  const std::size_t mask = slots_.size() - 1;
  std::size_t slot = sections * 0x9E3779B97F4A7C15u >> 32 & mask;
  for (; slots_[slot] != kNoTile; slot = (slot + 1) & mask)
    if (tiles_[slots_[slot]].sections == sections) return slots_[slot];
  const auto number = static_cast<std::uint32_t>(tiles_.size());
  Tile& tile = tiles_.emplace_back();
  tile.sections = sections;
  tile.key = tile_key({geometry_->entry_section(static_cast<std::uint32_t>(sections >> 32)),
                       geometry_->exit_section(static_cast<std::uint32_t>(sections))});
  touched_.push_back(tile.key);
  slots_[slot] = number;
  if (2 * tiles_.size() >= slots_.size()) rehash(4 * slots_.size());  // at most half full
  return number;
}

void TapGatherer::number_tiles(std::size_t count, const EntryArrays& entries, const Pass& pass) {
  const std::span<const EntryRow> rows = geometry_->entry_rows();
  const std::uint32_t columns = triangle_size(geometry_->exit_side());
  for (std::size_t c = 0; c < pass.entries; ++c) {
    const std::uint32_t* index = entries.index[c].data();
    const float* weight = entries.weight[c].data();
    const std::uint32_t* exit = pass.exit[c]->section.data();
    Tap* taps = taps_[c].data();
    std::uint64_t last = ~0ull;  // neighbours mostly share a tile
    std::uint32_t tile = kNoTile;
    for (std::size_t k = 0; k < count; ++k) {
      const EntryRow row = rows[index[k]];
      const std::uint64_t sections = std::uint64_t{row.section} << 32 | exit[k];
      if (weight[k] == 0) {
        taps[k] = {kNoTile, 0};
        continue;
      }
      if (sections != last) {
        tile = number_of(sections);
        last = sections;
      }
      taps[k] = {tile, row.row * columns};
    }
  }
}

Result<void> TapGatherer::pin(Wave wave) {
  if (wave.begin == wave.end) return {};
  const bool wait = wait_ || geometry_->level() == 0;  // something must be drawn
  if (wait) {
    std::vector<TileKey> keys;
    for (std::uint32_t n = wave.begin; n < wave.end; ++n) keys.push_back(tiles_[n].key);
    cache_.advise(color_, keys);
    if (depth_) cache_.advise(*depth_, keys);
  }
  tile_samples_.resize(tiles_.size());
  for (std::uint32_t n = wave.begin; n < wave.end; ++n)
    if (auto ok = pin(tiles_[n], tile_samples_[n], wait); !ok) return ok;
  return {};
}

Result<void> TapGatherer::pin(Tile& tile, TileSamples& samples, bool wait) {
  const auto take = [&](storage::LayerId layer) -> Result<TileCache::Pin> {
    if (wait) return cache_.get(layer, tile.key);
    TileCache::Pin found = cache_.find(layer, tile.key);
    if (!found) {
      samples = {nullptr, nullptr, true};
      wanted_.push_back(tile.key);
    }
    return found;
  };
  auto color = take(color_);
  if (!color) return tl::unexpected(color.error());
  if (!*color) return {};
  tile.color = std::move(*color);
  samples = {tile.color.samples(), nullptr, tile.color.state() == storage::TileState::missing};
  if (!samples.colors || !depth_) return {};
  auto depth = take(*depth_);
  if (!depth) return tl::unexpected(depth.error());
  if (!*depth) return {};
  tile.depth = std::move(*depth);
  samples.depths = tile.depth.samples();
  return {};
}

void TapGatherer::unpin(Wave wave) {
  for (std::uint32_t n = wave.begin; n < wave.end; ++n) tiles_[n].color = {}, tiles_[n].depth = {};
}

template <unsigned kExits, class Color>
void TapGatherer::take_typed(Wave wave, std::size_t count, const Pass& pass,
                             std::array<std::vector<Color>, 9>& colors) {
  for (std::size_t c = 0; c < pass.entries; ++c) {
    const Tap* taps = taps_[c].data();
    const std::uint32_t* column[kExits];
    Color* color[kExits];
    std::uint8_t* depth[kExits];
    for (std::size_t e = 0; e < kExits; ++e) {
      column[e] = pass.exit[c]->column[e].data();
      color[e] = colors[3 * c + e].data();
      depth[e] = samples_.depth[3 * c + e].data();
    }
    for (std::size_t k = 0; k < count; ++k) {
      const Tap tap = taps[k];
      if (tap.tile - wave.begin >= wave.end - wave.begin) continue;  // another wave's, or none's
      const TileSamples& tile = tile_samples_[tap.tile];
      if (!tile.colors) {
        missing_[k] |= tile.missing;
        continue;
      }
      for (std::size_t e = 0; e < kExits; ++e)
        load(tile.colors, tap.row + column[e][k], color[e][k]);
      if (!pass.with_depth || !tile.depths) continue;
      for (std::size_t e = 0; e < kExits; ++e)
        depth[e][k] = std::to_integer<std::uint8_t>(tile.depths[tap.row + column[e][k]]);
    }
  }
}

void TapGatherer::take(Wave wave, std::size_t count, const Pass& pass) {
  if (half_floats())
    pass.exits == 1 ? take_typed<1>(wave, count, pass, samples_.rgba16f)
                    : take_typed<3>(wave, count, pass, samples_.rgba16f);
  else
    pass.exits == 1 ? take_typed<1>(wave, count, pass, samples_.rgba8)
                    : take_typed<3>(wave, count, pass, samples_.rgba8);
}

Result<void> TapGatherer::gather(const LevelGeometry& geometry, std::size_t count,
                                 const EntryArrays& entries, const Pass& pass) {
  if (geometry_ != &geometry || 2 * tiles_.size() > most_pins_) forget_tiles();
  geometry_ = &geometry;
  number_tiles(count, entries, pass);
  // What no tile fills is nothing.
  std::fill_n(missing_.begin(), count, std::uint8_t{0});
  for (std::size_t s = 0; s < 9; ++s) {
    if (half_floats())
      std::fill_n(samples_.rgba16f[s].begin(), count, glm::vec4(0));
    else
      std::fill_n(samples_.rgba8[s].begin(), count, 0u);
    if (pass.with_depth) std::fill_n(samples_.depth[s].begin(), count, std::uint8_t{0});
  }
  const auto tiles = static_cast<std::uint32_t>(tiles_.size());
  if (tiles <= most_pins_) {
    if (auto ok = pin({pinned_, tiles}); !ok) return ok;
    pinned_ = tiles;
    take({0, tiles}, count, pass);
    return {};
  }
  // Too many to hold at once: none of them stays.
  unpin({0, pinned_});
  for (std::uint32_t begin = 0; begin < tiles; begin += most_pins_) {
    const Wave wave{begin, std::min(begin + most_pins_, tiles)};
    if (auto ok = pin(wave); !ok) return ok;
    take(wave, count, pass);
    unpin(wave);
  }
  forget_tiles();
  return {};
}

}  // namespace slf
