#include "field/write/encode_tile.h"

#include <vector>

#include "base/try.h"

namespace slf {

Result<void> encode_tile(TileCache& coarser, TileKey key, ByteSpan samples, Bytes& payload) {
  const TileCoder& coder = coarser.field().coder();
  std::vector<TileKey> keys;
  for (const Reference& reference : coder.choose(key, samples)) keys.push_back(reference.tile);
  const auto pins = SLF_TRY(coarser.load(keys));
  std::vector<ReferenceSamples> from;
  for (std::size_t k = 0; k < keys.size(); ++k) from.push_back({{keys[k]}, pins[k].samples()});
  return coder.encode(key, samples, from, payload);
}

}  // namespace slf
