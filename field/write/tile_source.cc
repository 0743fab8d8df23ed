#include "field/write/tile_source.h"

#include <algorithm>

#include "base/half.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/tiles/tile_cache.h"

namespace slf {
namespace {

using storage::TileState;

/// Converts colours, and appends them. Premultiplied colours of 8 bits are clamped to alpha.
void append_colors(ByteSpan in, bool from_half, bool to_half, Bytes& out) {
  if (from_half == to_half) {
    out.insert(out.end(), in.begin(), in.end());
  } else if (to_half) {
    out.resize(in.size() * 2);
    for (std::size_t k = 0; k < in.size(); ++k)
      store_le(&out[2 * k], half_from_byte(std::to_integer<std::uint8_t>(in[k])));
  } else {
    out.resize(in.size() / 2);
    for (std::size_t k = 0; k < out.size(); ++k)
      out[k] = std::byte{byte_from_half(load_le<std::uint16_t>(&in[2 * k]))};
    for (std::size_t k = 0; k < out.size(); k += 4)
      for (std::size_t c = k; c < k + 3; ++c) out[c] = std::min(out[c], out[k + 3]);
  }
}

}  // namespace

Result<void> StoredTiles::tile(TileKey key, SourceTile& tile) const {
  storage::TileRef& ref = tile.ref;
  ref = SLF_TRY(store_.find(alone_ ? in_state(key, state_) : key));
  const bool copied = ref.state == TileState::stored && (alone_ || ref.source == key);
  if (copied) SLF_TRY(store_.check(ref));
  if (!alone_) return {};
  ref.source = key;
  if (copied) ref.payload = SLF_TRY(alone_->without_states(key, ref.payload));
  return {};
}

void StoredTiles::prefetch(std::span<const TileKey> keys) const {
  store_.release_all();  // pages that were read stay in the kernel's cache
  std::vector<storage::TileRef> tiles;
  const auto own = alone_ ? in_state(keys, state_) : std::vector(keys.begin(), keys.end());
  for (const auto& found : store_.find_all(own))
    if (found) tiles.push_back(*found);
  store_.advise(tiles);
}

Result<void> DecodedTiles::tile(TileKey key, SourceTile& tile) const {
  const TileReader tiles = reader(key.state);
  const TileKey own = in_state(key, tiles.field().state());
  const auto pin = SLF_TRY(tiles.cache().load(own));
  tile.ref = {pin.state(), key};
  if (pin.state() != TileState::stored) return {};
  const FieldFile& field = tiles.field().file();
  const ByteSpan in = pin.samples(), colors = in.first(field.tile_shape(own).color_bytes());
  tile.samples.clear();
  append_colors(colors, is_half(field.format()), is_half(format_), tile.samples);
  if (has_depth(format_)) {
    const ByteSpan depths = in.subspan(colors.size());
    tile.samples.insert(tile.samples.end(), depths.begin(), depths.end());
  }
  return {};
}

void DecodedTiles::prefetch(std::span<const TileKey> keys) const {
  while (!keys.empty()) {
    const std::uint64_t state = keys.front().state;
    std::vector<TileKey> own;
    for (; !keys.empty() && keys.front().state == state; keys = keys.subspan(1))
      own.push_back(keys.front());
    const TileReader tiles = reader(state);
    for (const Field& source : sources_of(tiles.field())) source.file().store().release_all();
    (void)tiles.cache().find(in_state(own, tiles.field().state()));
  }
}

TileReader DecodedTiles::reader(std::uint64_t state) const {
  const std::size_t count = std::min(readers_.size(), states_.size());
  const std::lock_guard lock(mutex_);
  auto& kept = readers_[state % count];
  if (!kept || kept->first != state)
    kept.emplace(state, TileReader(states_[state].field, {.memory = memory_ / count}));
  return kept->second;
}

Result<void> CodedTiles::tile(TileKey key, SourceTile& tile) const {
  SLF_TRY(source_.tile(key, tile));
  if (tile.ref.state != TileState::stored) return {};
  Bytes payload;
  SLF_TRY(coder_.encode(key, tile.samples, {}, payload));
  return coder_.decode(key, payload, {}, tile.samples);
}

Result<void> KeptTiles::tile(TileKey key, SourceTile& tile) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = kept_.find(key); found != kept_.end()) {
      if (keeps_) {
        tile = found->second;
      } else {
        tile = std::move(found->second);
        kept_.erase(found);
      }
      return {};
    }
  }
  SLF_TRY(source_.tile(key, tile));
  if (!keeps_) return {};
  const std::uint64_t bytes = tile.ref.state == TileState::stored ? tile.samples.size() : 0;
  const std::lock_guard lock(mutex_);
  most_ = std::max(most_, source_.work(key.level));
  if (bytes_ + bytes > memory_ / most_ * source_.work(key.level)) return {};
  const auto [kept, added] = kept_.try_emplace(key, SourceTile{tile.ref, {}});
  if (!added) return {};
  if (bytes > 0) kept->second.samples = tile.samples;
  bytes_ += bytes;
  return {};
}

}  // namespace slf
