#include "field/write/encode_tile.h"

#include <algorithm>
#include <vector>

#include "base/try.h"

namespace slf {

namespace {

/// How many states before a tile's own are searched for one to predict it from.
constexpr std::uint64_t kSearchedStates = 64;

/// The tiles of earlier states that a tile may be predicted from: the latest one that is stored and
/// at the end of no full chain, and that of the first state.
Result<std::vector<TileKey>> earlier_tiles(const FieldFile& field, TileKey key) {
  std::vector<TileKey> found;
  if (!field.coder().uses_states()) return found;
  const std::uint64_t state = state_of(key);
  const auto add = [&](std::uint64_t earlier) -> Result<bool> {
    const auto tile = SLF_TRY(field.store().find(in_state(key, earlier)));
    if (tile.state != TileState::stored) return false;
    SLF_TRY(field.store().check(tile));
    auto own = tile;
    own.key = tile.source;
    const unsigned chain = SLF_TRY(field.chain(own));
    if (chain >= kMaxChain) return false;
    if (found.empty() || found.back() != tile.source) found.push_back(tile.source);
    return true;
  };
  bool added = false;
  for (std::uint64_t back = 1; !added && back <= std::min(state, kSearchedStates); ++back)
    added = SLF_TRY(add(state - back));
  if (state > 0) SLF_TRY(add(0));
  return found;
}

}  // namespace

Result<void> encode_tile(TileCache& coarser, TileKey key, ByteSpan samples, Bytes& payload) {
  const TileCoder& coder = coarser.field().coder();
  std::vector<TileKey> keys;
  for (const Reference& reference : coder.choose(key, samples)) keys.push_back(reference.tile);
  const auto pins = SLF_TRY(coarser.load(keys));
  std::vector<ReferenceSamples> from;
  for (std::size_t k = 0; k < keys.size(); ++k) from.push_back({{keys[k]}, pins[k].samples()});
  SLF_TRY(coder.encode(key, samples, from, payload));
  Bytes other;
  const auto others = SLF_TRY(earlier_tiles(coarser.field(), key));
  for (const TileKey earlier : others) {
    const auto pin = SLF_TRY(coarser.load(earlier));
    from.push_back({{earlier}, pin.samples()});
    SLF_TRY(coder.encode(key, samples, from, other));
    from.pop_back();
    if (other.size() < payload.size()) payload.swap(other);
  }
  return {};
}

}  // namespace slf
