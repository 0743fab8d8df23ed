#include "field/write/encode_tile.h"

#include <algorithm>
#include <vector>

#include "base/try.h"

namespace slf {

namespace {

/// How many states before a tile's own are searched for one to predict it from.
constexpr std::uint64_t kSearchedStates = 64;

static_assert(kMaxChain == 1, "what earlier_tiles() finds is predicted from coarser tiles alone");

/// The tiles of earlier states that a tile may be predicted from: the latest one that is stored and
/// not predicted from another state itself, and that of the first state.
Result<std::vector<storage::TileRef>> earlier_tiles(const FieldFile& field, TileKey key) {
  std::vector<storage::TileRef> found;
  const std::uint64_t state = key.state;
  const auto add = [&](std::uint64_t earlier) -> Result<bool> {
    auto tile = SLF_TRY(field.store().find(in_state(key, earlier)));
    if (tile.state != TileState::stored) return false;
    SLF_TRY(field.store().check(tile));
    tile.key = tile.source;
    const unsigned chain = SLF_TRY(field.chain(tile));
    if (chain >= kMaxChain) return false;
    if (found.empty() || found.back().key != tile.key) found.push_back(tile);
    return true;
  };
  bool added = false;
  for (std::uint64_t back = 1; !added && back <= std::min(state, kSearchedStates); ++back)
    added = SLF_TRY(add(state - back));
  if (state > 0) SLF_TRY(add(0));
  return found;
}

/// Coarser tiles, loaded.
struct Coarser {
  std::vector<TileCache::Pin> pins;
  std::vector<ReferenceSamples> samples;

  [[nodiscard]] static Result<Coarser> load(TileCache& cache, std::span<const TileKey> keys) {
    Coarser loaded;
    loaded.pins = SLF_TRY(cache.load(keys));
    for (std::size_t k = 0; k < keys.size(); ++k)
      loaded.samples.push_back({keys[k], loaded.pins[k].samples()});
    return loaded;
  }
};

}  // namespace

Result<void> encode_tile(const TileCoder& coder, TileCache* coarser, const FieldFile* earlier,
                         TileKey key, ByteSpan samples, Bytes& payload) {
  Coarser from;
  if (coarser) from = SLF_TRY(Coarser::load(*coarser, coder.choose(key, samples)));
  SLF_TRY(coder.encode(key, samples, from.samples, payload));
  if (!coder.uses_states()) return {};
  Bytes other, decoded(samples.size());
  const auto others = SLF_TRY(earlier_tiles(*earlier, key));
  for (const storage::TileRef& tile : others) {
    const auto named = SLF_TRY(earlier->references(tile));
    const auto below = SLF_TRY(Coarser::load(*coarser, named));
    SLF_TRY(earlier->decode(tile, below.samples, decoded));
    from.samples.push_back({tile.key, decoded});
    SLF_TRY(coder.encode(key, samples, from.samples, other));
    from.samples.pop_back();
    if (other.size() < payload.size()) payload.swap(other);
  }
  return {};
}

}  // namespace slf
