// Trains the models of the predictive codec:
//   train_predictive [-s ALPHA,BLOCK] [-x] FIELD.slf... > codec/predictive_trained.inc
//
// Encodes the fields, which should be lossless and of many kinds, at several qualities, and
// collects the symbols of each tile. Tiles are divided into ALPHA (4) groups by the symbols of
// their levels of alpha, planes of blocks into BLOCK (8) groups: each goes to the group whose
// models code it in the fewest bits, the models are computed anew, and so on (k-means, Lloyd 1982).
//
// With -x, prints nothing but how well fields are coded with models trained on the others.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <numeric>
#include <string_view>

#include "benchmarks/predictive_weights.h"
#include "codec/predictive_codec.h"
#include "codec/predictive_training.h"
#include "field/geometry/tile_order.h"
#include "field/tiles/tile_cache.h"

namespace {

using namespace slf;
using codec::ModelGroup;

constexpr int kQualities[] = {60, 80, 90, 95};
constexpr int kRounds = 8;
/// Of the finest level, only every kEvery-th tile is used.
constexpr std::uint64_t kEvery = 8;

template <class T>
T expect(Result<T> result) {
  if (result) {
    if constexpr (std::is_void_v<T>)
      return;
    else
      return std::move(*result);
  }
  std::fprintf(stderr, "train_predictive: %s\n", result.error().message.c_str());
  std::exit(static_cast<int>(result.error().code));
}

/// What the fields have shown.
struct Training {
  std::vector<std::vector<codec::TilePart>> parts;  // per field
  /// Per kind of level, kind of candidate and whether the last one was used: not used, used.
  std::array<std::array<std::array<std::array<double, 2>, 2>, codec::kReferenceKinds>, 2> used{};
  std::vector<double> bytes;  // per field, as coded with the models of this program
};

/// A tile's colour and depth, one after the other; empty where nothing is visible.
Bytes samples_of(TileCache& cache, TileKey key) {
  const auto pin = expect(cache.load(key));
  const ByteSpan samples = pin.samples();
  return {samples.begin(), samples.end()};
}

void collect(const FieldFile& field, std::size_t number, int quality, Training& training) {
  const FieldShape& shape = field.shape();
  const codec::PredictiveSettings settings{quality};
  codec::TileSymbols symbols;
  const codec::PredictiveCodec codec(settings,
                                     codec::predictive_tables(settings, shape.finest_level),
                                     [&](const auto& of_tile) { symbols = of_tile; });
  const TileCoder tiles(shape, settings.format, codec, [&](unsigned level) -> const LevelGeometry& {
    return field.geometry(level);
  });
  TileCache cache(field, 64 << 20);
  std::map<TileKey, Bytes> decoded;
  const auto samples_of_all = [&](const std::vector<TileKey>& references) {
    std::vector<ReferenceSamples> from;
    for (const TileKey reference : references)
      if (const auto found = decoded.find(reference); found != decoded.end())
        from.push_back({reference, found->second});
    return from;
  };
  const TileOrder order(shape);
  for (std::uint64_t n = 0; n < order.count(); ++n) {
    const TileKey key = order.key(n);
    if (key.level == shape.finest_level && key.level > 0 && n % kEvery != 0) continue;
    const Bytes samples = samples_of(cache, key);
    if (samples.empty()) continue;
    Bytes payload;
    expect(tiles.encode(key, samples, samples_of_all(tiles.choose(key, samples)), payload));
    training.bytes[number] += static_cast<double>(payload.size());
    bool last = false;
    for (std::size_t k = 0; k < symbols.used.size(); ++k) {
      const bool used = symbols.used[k] != 0;
      ++training.used[symbols.level_kind][symbols.kinds[k]][last ? 1 : 0][used ? 1 : 0];
      last = used;
    }
    codec::append_parts(symbols, training.parts[number]);
    if (key.level == shape.finest_level) continue;
    Bytes back(samples.size());
    expect(tiles.decode(key, payload, samples_of_all(tiles.references(key, payload)), back));
    decoded[key] = std::move(back);
  }
}

using PartPointers = std::vector<const codec::TilePart*>;

bool is_alpha(const codec::TilePart& part) { return part.plane == codec::kPlanes; }

/// Sets of models for these parts, by k-means.
codec::ModelSets train(const PartPointers& parts, std::span<const ModelGroup> groups,
                       std::size_t count) {
  // At first, groups by the share of even bits: the detail.
  std::vector<std::size_t> group(parts.size()), order(parts.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto detail = [&](std::size_t k) {
    return (static_cast<double>(parts[k]->even_bits) + 0.5) /
           (static_cast<double>(parts[k]->total) + 1);
  };
  std::ranges::stable_sort(order, {}, detail);
  std::uint64_t total = 0, before = 0;
  for (const codec::TilePart* part : parts) total += part->total;
  for (const std::size_t k : order) {
    group[k] = std::min<std::size_t>(count - 1, before * count / total);
    before += parts[k]->total;
  }
  codec::ModelSets sets(groups, count);
  // What a set has hardly seen is as in all sets together.
  auto all = codec::ModelSets(groups, 1).counts(parts, std::vector<std::size_t>(parts.size()))[0];
  for (double& symbols : all) symbols += 0.1;
  const std::vector<std::vector<double>> prior(count, all);
  for (int round = 0; round < kRounds; ++round) {
    for (std::size_t k = 0; k < parts.size() && round > 0; ++k)
      group[k] = sets.best(*parts[k]).first;
    sets.fit(parts, group, prior);
  }
  return sets;
}

/// The models of all kinds of part, trained on fields other than `without`.
struct Models {
  codec::ModelSets alpha, blocks;

  Models(const Training& training, std::size_t alpha_sets, std::size_t block_sets,
         std::size_t without)
      : alpha(train(parts_of(training, true, without), codec::AlphaModels::kGroups, alpha_sets)),
        blocks(train(parts_of(training, false, without), codec::BlockModels::kGroups, block_sets)) {
  }
  /// In bytes.
  [[nodiscard]] std::uint64_t size(const std::vector<codec::TilePart>& parts) const {
    std::uint64_t bits = 0;
    for (const auto& part : parts) bits += (is_alpha(part) ? alpha : blocks).best(part).second;
    return bits >> 19;
  }

 private:
  static PartPointers parts_of(const Training& training, bool of_alpha, std::size_t without) {
    PartPointers parts;
    for (std::size_t field = 0; field < training.parts.size(); ++field)
      for (const codec::TilePart& part : training.parts[field])
        if (field != without && is_alpha(part) == of_alpha) parts.push_back(&part);
    return parts;
  }
};

void cross_validate(const Training& training, char** names, std::size_t alpha_sets,
                    std::size_t block_sets) {
  for (std::size_t field = 0; field < training.bytes.size(); ++field) {
    const Models others(training, alpha_sets, block_sets, field);
    const Models all(training, alpha_sets, block_sets, training.bytes.size());
    std::printf("%s: %llu bytes with models of others, %llu with those of all\n", names[field],
                static_cast<unsigned long long>(others.size(training.parts[field])),
                static_cast<unsigned long long>(all.size(training.parts[field])));
  }
}

/// The models as they are stored, compressed.
Bytes packed_models(const Training& training, std::size_t alpha_sets, std::size_t block_sets) {
  const Models models(training, alpha_sets, block_sets, training.bytes.size());
  codec::StoredModels stored;
  std::size_t at = 0;
  for (const auto& of_level : training.used)
    for (const auto& of_kind : of_level)
      for (const auto& [unused, used] : of_kind)
        stored.used[at++] = bench::byte_of_probability((used + 0.4) / (unused + used + 0.8));
  stored.alpha_sets = alpha_sets, stored.block_sets = block_sets;
  stored.weights.resize(stored.choices(2));
  std::vector<codec::TilePart> parts;
  for (const auto& of_field : training.parts)
    parts.insert(parts.end(), of_field.begin(), of_field.end());
  codec::fit_choices(parts, models.alpha, models.blocks, stored);
  for (const codec::ModelSets* const sets : {&models.alpha, &models.blocks})
    for (std::size_t set = 0; set < sets->sets(); ++set)
      stored.weights.insert(stored.weights.end(), sets->weights(set).begin(),
                            sets->weights(set).end());
  return expect(stored.pack());
}

}  // namespace

int main(int argc, char** argv) {
  std::size_t alpha_sets = 4, block_sets = 8;
  bool cross = false;
  int first = 1;
  for (; first < argc && argv[first][0] == '-'; ++first)
    if (std::string_view(argv[first]) == "-x")
      cross = true;
    else if (++first < argc)
      std::sscanf(argv[first], "%zu,%zu", &alpha_sets, &block_sets);
  Training training;
  for (int k = first; k < argc; ++k) {
    const auto field = expect(FieldFile::open(argv[k]));
    training.bytes.push_back(0);
    training.parts.emplace_back();
    for (const int quality : kQualities)
      collect(*field, static_cast<std::size_t>(k - first), quality, training);
    std::fprintf(stderr, "%s: %.0f bytes\n", argv[k], training.bytes.back());
  }
  if (cross) {
    cross_validate(training, argv + first, alpha_sets, block_sets);
    return 0;
  }
  const Bytes packed = packed_models(training, alpha_sets, block_sets);
  for (std::size_t k = 0; k < packed.size(); ++k)
    std::printf("%d,%s", std::to_integer<int>(packed[k]), k % 24 == 23 ? "\n" : " ");
  std::printf("\n");
}
