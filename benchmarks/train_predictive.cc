// Trains the probabilities that the models of the predictive codec begin with:
//   train_predictive FIELD.slf... > codec/predictive_trained.inc
//
// Encodes the fields, which should be lossless and of many kinds, at two qualities, and counts the
// decisions of each model: of level 0, and of all other levels.
#include <cstdio>
#include <map>

#include "codec/predictive_codec.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"

namespace {

using namespace slf;

/// Of the finest level, only every kEvery-th tile is used.
constexpr std::uint64_t kEvery = 6;

template <class T>
T expect(Result<T> result) {
  if (result) return std::move(*result);
  std::fprintf(stderr, "train_predictive: %s\n", result.error().message.c_str());
  std::exit(static_cast<int>(result.error().code));
}

/// A tile's colour and depth, one after the other; empty where nothing is visible.
Bytes samples_of(const FieldFile& field, TileKey key) {
  Bytes both;
  for (const char* name : {"color", "depth"}) {
    const auto layer = field.layer(name);
    if (!layer) continue;
    const auto tile = expect(field.store().find(*layer, key));
    if (tile.state != storage::TileState::stored) return {};
    Bytes samples(field.tile_shape(*layer, key).bytes());
    if (auto ok = field.decode(tile, samples); !ok) expect<int>(tl::unexpected(ok.error()));
    both.insert(both.end(), samples.begin(), samples.end());
  }
  return both;
}

void count(const FieldFile& field, int quality, std::array<codec::BitCounts, 2>& counts) {
  const FieldShape& shape = field.shape();
  const codec::PredictiveCodec codec({quality}, codec::predictive_tables({quality}, shape.levels));
  const PredictedTiles tiles(
      shape, codec, [&](unsigned level) -> const LevelGeometry& { return field.geometry(level); });
  std::map<TileKey, TileSamples> decoded;
  const ReferenceSource source = [&](TileKey key) -> Result<TileSamples> {
    const auto found = decoded.find(key);
    return found == decoded.end() ? TileSamples() : found->second;
  };
  const TileOrder order(shape);
  for (std::uint64_t n = 0; n < order.count(); ++n) {
    const TileKey key = order.key(n);
    if (key.level == shape.levels && key.level > 0 && n % kEvery != 0) continue;
    const Bytes samples = samples_of(field, key);
    if (samples.empty()) continue;
    Bytes payload;
    auto ok = tiles.encode(key, samples, source, payload, &counts[key.level == 0 ? 0 : 1]);
    const auto back = std::make_shared<Bytes>(samples.size());
    if (ok) ok = tiles.decode(key, payload, source, *back);
    if (!ok) expect<int>(tl::unexpected(ok.error()));
    if (key.level < shape.levels) decoded[key] = back;
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::array<codec::BitCounts, 2> counts;
  for (auto& of_set : counts) of_set.resize(codec::PredictiveModels::kCount);
  for (int k = 1; k < argc; ++k) {
    const auto field = expect(FieldFile::open(argv[k]));
    for (const int quality : {60, 90}) count(*field, quality, counts);
    std::fprintf(stderr, "%s\n", argv[k]);
  }
  std::size_t printed = 0;
  for (const auto& of_set : counts)
    for (const auto& [zeros, ones] : of_set)
      std::printf("%d,%s", codec::byte_of_probability((ones + 0.4) / (zeros + ones + 0.8)),
                  ++printed % 24 == 0 ? "\n" : " ");
  std::printf("\n");
}
