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
#include "codec/zstd_frame.h"
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

/// A part of a tile that chooses a set of models.
struct Part {
  std::size_t field = 0, level_kind = 0;
  std::size_t plane = 0;  // codec::kPlanes: levels of alpha
  struct Symbol {
    std::uint16_t model, value;
    std::uint32_t count;
  };
  std::vector<Symbol> symbols;
  double even_bits = 0;
  double total = 0;  // symbols
};

Part make_part(const codec::SymbolList& list, Part part) {
  std::map<std::uint32_t, std::uint32_t> counts;
  for (const auto& entry : list.entries())
    if (entry.even())
      part.even_bits += entry.bits();
    else
      ++counts[std::uint32_t{entry.model} << 16 | entry.value];
  for (const auto& [symbol, count] : counts) {
    part.symbols.push_back({static_cast<std::uint16_t>(symbol >> 16),
                            static_cast<std::uint16_t>(symbol & 0xFFFF), count});
    part.total += count;
  }
  return part;
}

/// What the fields have shown.
struct Training {
  std::vector<Part> parts;
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
  const codec::PredictiveCodec codec(settings, codec::predictive_tables(settings, shape.levels),
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
    if (key.level == shape.levels && key.level > 0 && n % kEvery != 0) continue;
    const Bytes samples = samples_of(cache, key);
    if (samples.empty()) continue;
    Bytes payload;
    expect(tiles.encode(key, samples, samples_of_all(tiles.choose(key, samples)), payload));
    training.bytes[number] += static_cast<double>(payload.size());
    const std::size_t level_kind = key.level == 0 ? 0 : 1;
    bool last = false;
    for (std::size_t k = 0; k < symbols.used.size(); ++k) {
      const bool used = symbols.used[k] != 0;
      ++training.used[level_kind][symbols.kinds[k]][last ? 1 : 0][used ? 1 : 0];
      last = used;
    }
    const auto add = [&](const codec::SymbolList& list, std::size_t plane) {
      if (!list.entries().empty())
        training.parts.push_back(make_part(list, {number, level_kind, plane, {}}));
    };
    add(symbols.alpha, codec::kPlanes);
    for (std::size_t plane = 0; plane < codec::kPlanes; ++plane) add(symbols.planes[plane], plane);
    if (key.level == shape.levels) continue;
    Bytes back(samples.size());
    expect(tiles.decode(key, payload, samples_of_all(tiles.references(key, payload)), back));
    decoded[key] = std::move(back);
  }
}

/// Sets of models, as weights and as bits of each symbol.
class Sets {
 public:
  template <std::size_t kGroups>
  explicit Sets(const std::array<ModelGroup, kGroups>& groups) {
    first_.push_back(0);
    for (const ModelGroup& group : groups)
      for (std::size_t k = 0; k < group.models; ++k)
        first_.push_back(first_.back() + group.symbols);
  }

  void train(const std::vector<const Part*>& parts, std::size_t sets) {
    // At first, groups by the share of even bits: the detail.
    std::vector<std::size_t> group(parts.size()), order(parts.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    const auto detail = [&](std::size_t k) {
      return (parts[k]->even_bits + 0.5) / (parts[k]->total + 1);
    };
    std::ranges::stable_sort(order, {}, detail);
    double total = 0, before = 0;
    for (const Part* part : parts) total += part->total;
    for (const std::size_t k : order) {
      group[k] =
          std::min(sets - 1, static_cast<std::size_t>(before / total * static_cast<double>(sets)));
      before += parts[k]->total;
    }
    for (int round = 0; round < kRounds; ++round) {
      if (round > 0)
        for (std::size_t k = 0; k < parts.size(); ++k) group[k] = best(*parts[k]).first;
      compute(parts, group, sets);
    }
  }

  [[nodiscard]] std::pair<std::size_t, double> best(const Part& part) const {
    std::pair<std::size_t, double> least{0, 1e300};
    for (std::size_t set = 0; set < bits_.size(); ++set) {
      double bits = part.even_bits;
      for (const auto& symbol : part.symbols)
        bits += symbol.count * bits_[set][first_[symbol.model] + symbol.value];
      if (bits < least.second) least = {set, bits};
    }
    return least;
  }
  [[nodiscard]] const std::vector<std::vector<std::uint8_t>>& weights() const { return weights_; }

 private:
  void compute(const std::vector<const Part*>& parts, const std::vector<std::size_t>& group,
               std::size_t sets) {
    // What a set has hardly seen is as in all sets together.
    constexpr double kPrior = 30;
    std::vector<std::vector<double>> counts(sets, std::vector<double>(first_.back()));
    std::vector<double> all(first_.back(), 0.1);
    for (std::size_t k = 0; k < parts.size(); ++k)
      for (const auto& symbol : parts[k]->symbols) {
        counts[group[k]][first_[symbol.model] + symbol.value] += symbol.count;
        all[first_[symbol.model] + symbol.value] += symbol.count;
      }
    weights_.assign(sets, std::vector<std::uint8_t>(first_.back()));
    bits_.assign(sets, std::vector<double>(first_.back()));
    for (std::size_t set = 0; set < sets; ++set)
      for (std::size_t model = 0; model + 1 < first_.size(); ++model) {
        const std::size_t begin = first_[model], size = first_[model + 1] - begin;
        const std::span shared = std::span(all).subspan(begin, size);
        const std::span own = std::span(counts[set]).subspan(begin, size);
        const double sum = std::accumulate(shared.begin(), shared.end(), 0.);
        for (std::size_t k = 0; k < size; ++k) own[k] += kPrior * shared[k] / sum;
        const std::span stored = std::span(weights_[set]).subspan(begin, size);
        bench::store_weights(own, stored);
        const codec::SymbolModel coded(stored);
        for (std::size_t k = 0; k < size; ++k)
          bits_[set][begin + k] =
              codec::SymbolModel::kBits - std::log2(coded.frequency(static_cast<std::uint32_t>(k)));
      }
  }

  std::vector<std::size_t> first_;  // symbol of each model, and their number
  std::vector<std::vector<std::uint8_t>> weights_;
  std::vector<std::vector<double>> bits_;
};

/// The models of all kinds of part, trained on fields other than `without`.
struct Models {
  Sets alpha{codec::AlphaModels::kGroups}, blocks{codec::BlockModels::kGroups};

  Models(const Training& training, std::size_t alpha_sets, std::size_t block_sets,
         std::size_t without) {
    std::vector<const Part*> of_alpha, of_blocks;
    for (const Part& part : training.parts)
      if (part.field != without)
        (part.plane == codec::kPlanes ? of_alpha : of_blocks).push_back(&part);
    alpha.train(of_alpha, alpha_sets);
    blocks.train(of_blocks, block_sets);
  }
  [[nodiscard]] const Sets& of(const Part& part) const {
    return part.plane == codec::kPlanes ? alpha : blocks;
  }
};

void cross_validate(const Training& training, char** names, std::size_t alpha_sets,
                    std::size_t block_sets) {
  for (std::size_t field = 0; field < training.bytes.size(); ++field) {
    const Models others(training, alpha_sets, block_sets, field);
    const Models all(training, alpha_sets, block_sets, training.bytes.size());
    double bits = 0, bits_of_all = 0;
    for (const Part& part : training.parts) {
      if (part.field != field) continue;
      bits += others.of(part).best(part).second;
      bits_of_all += all.of(part).best(part).second;
    }
    std::printf("%s: %.0f bytes with models of others, %.0f with those of all\n", names[field],
                bits / 8, bits_of_all / 8);
  }
}

/// The models as they are stored, compressed.
Bytes packed_models(const Training& training, std::size_t alpha_sets, std::size_t block_sets) {
  const Models models(training, alpha_sets, block_sets, training.bytes.size());
  std::array<std::vector<double>, 2> alpha_choices;
  std::array<std::array<std::vector<double>, codec::kPlanes>, 2> block_choices;
  for (std::size_t kind = 0; kind < 2; ++kind) {
    alpha_choices[kind].assign(alpha_sets + 1, 1);
    for (auto& choices : block_choices[kind]) choices.assign(block_sets + 1, 1);
  }
  std::array<double, 2> tiles{1, 1};
  for (const Part& part : training.parts) {
    const std::size_t kind = part.level_kind, set = models.of(part).best(part).first;
    if (part.plane == codec::kPlanes)
      ++alpha_choices[kind][set];
    else
      ++block_choices[kind][part.plane][set];
    if (part.plane == codec::kAlphaPlane) ++alpha_choices[kind][alpha_sets];
    if (part.plane == codec::kDepthPlane) ++tiles[kind];
  }
  // Planes of zeros are not among the parts.
  for (std::size_t kind = 0; kind < 2; ++kind)
    for (std::size_t plane = codec::kDepthPlane; plane < codec::kPlanes; ++plane) {
      auto& choices = block_choices[kind][plane];
      choices.back() =
          std::max(1., tiles[kind] - std::accumulate(choices.begin(), choices.end(), 0.));
    }

  Bytes packed;
  for (const auto& of_level : training.used)
    for (const auto& of_kind : of_level)
      for (const auto& [unused, used] : of_kind)
        packed.push_back(static_cast<std::byte>(
            bench::byte_of_probability((used + 0.4) / (unused + used + 0.8))));
  packed.push_back(static_cast<std::byte>(alpha_sets));
  packed.push_back(static_cast<std::byte>(block_sets));
  std::vector<std::uint8_t> weights;
  const auto store = [&](const std::vector<double>& counts) {
    weights.resize(weights.size() + counts.size());
    bench::store_weights(counts, std::span(weights).last(counts.size()));
  };
  for (std::size_t kind = 0; kind < 2; ++kind) {
    store(alpha_choices[kind]);
    for (const auto& choices : block_choices[kind]) store(choices);
  }
  for (const Sets* const sets : {&models.alpha, &models.blocks})
    for (const auto& set : sets->weights()) weights.insert(weights.end(), set.begin(), set.end());
  expect(codec::append_stream(std::as_bytes(std::span(weights)), 19, packed));
  return packed;
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
