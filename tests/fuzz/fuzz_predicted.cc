// Tiles that are predicted from others: any payload decodes against the references
// that it names, never against fewer, and what is encoded decodes.
//
// Input: byte 0 the shape, and from 128 on a tile of the second state; byte 1 what to do, byte 2
// the quality, bytes 3 and 4 the tile; the rest is the payload or the samples, and the samples of
// all references.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "codec/predictive_codec.h"
#include "field/tile_coder.h"
#include "slf/shape.h"

namespace {

using namespace slf;

void require(bool promise) {
  if (!promise) std::abort();
}

/// A shape with its levels, which are costly to make.
struct Lattices {
  FieldShape shape;
  std::vector<std::unique_ptr<LevelGeometry>> levels;
};

Lattices make(unsigned choice) {
  Lattices made;
  made.shape.sphere = {.center = glm::dvec3(0), .radius = 1};
  made.shape.entry_side = 1u << choice % 3;
  made.shape.exit_side = 2u << choice / 3 % 3;
  made.shape.entry_extra_levels = choice / 9 % 2 && choice % 3 ? 1 : 0;
  made.shape.finest_level = 2;
  require(made.shape.check().has_value());
  for (unsigned level = 0; level <= made.shape.finest_level; ++level)
    made.levels.push_back(std::make_unique<LevelGeometry>(made.shape, level));
  return made;
}

const Lattices& lattices(unsigned choice) {
  constexpr unsigned kChoices = 18;
  static std::vector<std::optional<Lattices>> all(kChoices);
  auto& found = all[choice % kChoices];
  if (!found) found = make(choice % kChoices);
  return *found;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 5) return 0;
  const Lattices& made = lattices(data[0]);
  const codec::PredictiveSettings settings{
      1 + data[2] % codec::kLosslessQuality,
      data[1] < 128 ? SampleFormat::rgba8_depth8 : SampleFormat::rgba16f_depth8};
  const auto geometry = [&](unsigned level) -> const LevelGeometry& { return *made.levels[level]; };
  const auto bytes_of = [&](TileKey key) {
    const auto sections = sections_of(key, made.shape.entry_extra_levels);
    return geometry(key.level).tile(sections.entry.index, settings.format).bytes();
  };
  const codec::PredictiveCodec codec(settings,
                                     codec::predictive_tables(settings, made.shape.finest_level));
  const unsigned state = data[0] < 128 ? 0 : 1;
  const TileCoder tiles(made.shape, settings.format, codec, geometry, state > 0, state > 0);
  TileKey key{static_cast<std::uint8_t>(data[1] / 2 % 3), 0};
  key.index = (data[3] | data[4] << 8) % made.shape.tiles(key.level);
  key = in_state(key, state);
  const ByteSpan rest = std::as_bytes(std::span(data + 5, size - 5));
  const auto repeated = [&](std::size_t count, std::size_t from) {
    Bytes bytes(count);
    for (std::size_t k = 0; k < count && !rest.empty(); ++k)
      bytes[k] = rest[(from + k) % rest.size()];
    return bytes;
  };

  std::map<TileKey, Bytes> references;
  const auto samples_of = [&](const std::vector<TileKey>& named) {
    std::vector<ReferenceSamples> from;
    for (const TileKey of : named) {
      if (of.level == key.level && of.state > state) continue;  // before the first state
      require(of.level == key.level ? of == in_state(key, 0)
                                    : of.level + 1 == key.level && of.state == state);
      require(of.index < made.shape.tiles(of.level));
      const bool empty = of.index % 5 == 4;  // nothing is visible there
      auto& bytes = references[of];
      if (!empty) bytes = repeated(bytes_of(of), of.index);
      from.push_back({of, bytes});
    }
    return from;
  };
  const std::size_t count = bytes_of(key);
  const auto decode = [&](ByteSpan payload) {
    // Exactly as large as they must be, so that the sanitizer reports every overrun.
    const auto exact = std::make_unique<std::byte[]>(payload.size());
    std::copy(payload.begin(), payload.end(), exact.get());
    const auto samples = std::make_unique<std::byte[]>(count);
    const ByteSpan view(exact.get(), payload.size());
    auto from = samples_of(tiles.references(key, view));
    const bool good = tiles.decode(key, view, from, {samples.get(), count}).has_value();
    if (count > 0 && !from.empty()) {  // without one of them, it is refused
      from.pop_back();
      require(!tiles.decode(key, view, from, {samples.get(), count}).has_value());
    }
    return good;
  };
  if (state > 0 && count == 0) return 0;  // fields store no such tile
  if (data[1] % 2 == 0) {
    (void)decode(rest);
    return 0;
  }
  Bytes samples = repeated(count, rest.size() / 2), payload;
  // Premultiplied: no channel exceeds alpha.
  for (std::size_t s = 0; s < count / 5 * 4; s += 4)
    for (std::size_t c = 0; c < 3; ++c) samples[s + c] = std::min(samples[s + c], samples[s + 3]);
  auto named = tiles.choose(key, samples);
  if (state > 0) named.push_back(in_state(key, 0));
  const auto from = samples_of(named);
  require(tiles.encode(key, samples, from, payload).has_value() && decode(payload));
  return 0;
}
