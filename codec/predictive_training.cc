#include "codec/predictive_training.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <numeric>

#include "base/try.h"
#include "codec/predictive_codec.h"

namespace slf::codec {
namespace {

/// Passes of k-means over the parts.
constexpr int kRounds = 4;
/// How many symbols of a model the general ones count for.
constexpr double kPrior = 60;

/// The bits of a symbol of this frequency, in 1/65536.
std::uint32_t bits_of(std::uint32_t frequency) {
  static const std::vector<std::uint32_t> all = [] {
    std::vector<std::uint32_t> bits{0};
    for (std::uint32_t f = 1; f <= 1u << SymbolModel::kBits; ++f)
      bits.push_back(static_cast<std::uint32_t>(
          std::lround(65536 * (SymbolModel::kBits - std::log2(static_cast<double>(f))))));
    return bits;
  }();
  return all[frequency];
}

/// Adds kPrior to a model's counts, in the proportions of `shares`.
template <class Shares>
void add_prior(const Shares& shares, std::span<double> counts) {
  const double sum = std::accumulate(shares.begin(), shares.end(), 0.);
  for (std::size_t k = 0; k < counts.size(); ++k) counts[k] += kPrior * shares[k] / sum;
}

using Vector = std::array<double, 3>;
using Matrix = std::array<Vector, 3>;

Matrix product(const Matrix& a, const Matrix& b) {
  Matrix c{};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      for (std::size_t k = 0; k < 3; ++k) c[i][j] += a[i][k] * b[k][j];
  return c;
}

/// The eigenvector of the largest eigenvalue of a symmetric, positive matrix.
Vector main_axis(Matrix m) {
  for (int squared = 0; squared < 30; ++squared) {
    const double trace = m[0][0] + m[1][1] + m[2][2];
    for (Vector& row : m)
      for (double& element : row) element /= trace;
    m = product(m, m);
  }
  const auto longest = std::ranges::max_element(
      m, {}, [](const Vector& v) { return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]; });
  Vector axis = *longest;
  const double length = std::sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
  for (double& element : axis) element /= length;
  return axis;
}

}  // namespace

void append_parts(const TileSymbols& tile, std::vector<TilePart>& parts) {
  const auto append = [&](const SymbolList& list, std::size_t plane) {
    if (list.entries().empty()) return;
    TilePart& part = parts.emplace_back();
    part.level_kind = tile.level_kind, part.plane = plane;
    std::map<std::uint32_t, std::uint32_t> counts;
    for (const auto& entry : list.entries())
      if (entry.even())
        part.even_bits += static_cast<std::uint64_t>(entry.bits());
      else
        ++counts[std::uint32_t{entry.model} << 16 | entry.value], ++part.total;
    for (const auto& [symbol, count] : counts)
      part.symbols.push_back({static_cast<std::uint16_t>(symbol >> 16),
                              static_cast<std::uint16_t>(symbol & 0xFFFF), count});
  };
  append(tile.alpha, kPlanes);
  for (std::size_t plane = 0; plane < kPlanes; ++plane) append(tile.planes[plane], plane);
}

void store_weights(std::span<const double> counts, std::span<std::uint8_t> weights) {
  const double sum = std::accumulate(counts.begin(), counts.end(), 0.);
  for (std::size_t k = 0; k < counts.size(); ++k) {
    // A weight of 4, the least, is 1/4096.
    const double wanted = 16384 * counts[k] / sum;
    // Rare symbols cost little however coarse their weights are, but these fill the tables.
    const auto next = [](int weight) { return weight < 16 ? weight + 4 : weight + 1; };
    const auto off = [&](int weight) {
      return std::abs(SymbolModel::weight_of(static_cast<std::uint8_t>(weight)) - wanted);
    };
    int best = 0;
    while (next(best) < SymbolModel::kWeights && off(next(best)) < off(best)) best = next(best);
    weights[k] = static_cast<std::uint8_t>(best);
  }
}

ModelSets::ModelSets(std::span<const ModelGroup> groups, std::size_t sets)
    : first_{0}, weights_(sets) {
  for (const ModelGroup& group : groups)
    for (std::size_t k = 0; k < group.models; ++k) first_.push_back(first_.back() + group.symbols);
  for (auto& weights : weights_) weights.resize(first_.back());
  bits_.assign(sets, std::vector<std::uint32_t>(first_.back()));
}

void ModelSets::set_weights(std::size_t set, std::span<const std::uint8_t> weights) {
  std::ranges::copy(weights, weights_[set].begin());
  for (std::size_t model = 0; model + 1 < first_.size(); ++model) {
    const std::size_t begin = first_[model], size = first_[model + 1] - begin;
    const SymbolModel coded(weights.subspan(begin, size));
    for (std::uint32_t k = 0; k < size; ++k) bits_[set][begin + k] = bits_of(coded.frequency(k));
  }
}

std::vector<std::vector<double>> ModelSets::counts(std::span<const TilePart* const> parts,
                                                   std::span<const std::size_t> group) const {
  std::vector<std::vector<double>> counts(sets(), std::vector<double>(symbols()));
  for (std::size_t k = 0; k < parts.size(); ++k)
    for (const auto& symbol : parts[k]->symbols) counts[group[k]][index(symbol)] += symbol.count;
  return counts;
}

void ModelSets::fit(std::span<const TilePart* const> parts, std::span<const std::size_t> group,
                    std::span<const std::vector<double>> prior) {
  auto all = counts(parts, group);
  std::vector<std::uint8_t> weights(symbols());
  for (std::size_t set = 0; set < sets(); ++set) {
    for (std::size_t model = 0; model + 1 < first_.size(); ++model) {
      const std::size_t begin = first_[model], size = first_[model + 1] - begin;
      const std::span own = std::span(all[set]).subspan(begin, size);
      const std::span before = std::span(prior[set]).subspan(begin, size);
      add_prior(before, own);
      store_weights(own, std::span(weights).subspan(begin, size));
    }
    set_weights(set, weights);
  }
}

std::pair<std::size_t, std::uint64_t> ModelSets::best(const TilePart& part) const {
  std::pair<std::size_t, std::uint64_t> least{0, ~std::uint64_t{0}};
  for (std::size_t set = 0; set < sets(); ++set) {
    std::uint64_t bits = part.even_bits << 16;
    for (const auto& symbol : part.symbols)
      bits += std::uint64_t{symbol.count} * bits_[set][index(symbol)];
    if (bits < least.second) least = {set, bits};
  }
  return least;
}

void fit_choices(std::span<const TilePart> parts, const ModelSets& alpha, const ModelSets& blocks,
                 StoredModels& models) {
  for (std::size_t kind = 0; kind < 2; ++kind) {
    // Of levels of alpha, then of planes; the last choice is alpha as a plane, a plane of zeros.
    std::vector<std::vector<double>> choices(1, std::vector<double>(alpha.sets() + 1));
    choices.resize(1 + kPlanes, std::vector<double>(blocks.sets() + 1));
    for (const TilePart& part : parts) {
      if (part.level_kind != kind) continue;
      const bool levels = part.plane == kPlanes;
      ++choices[levels ? 0 : 1 + part.plane][(levels ? alpha : blocks).best(part).first];
      if (part.plane == kAlphaPlane) ++choices[0].back();
    }
    const double tiles = std::accumulate(choices[0].begin(), choices[0].end(), 0.);
    auto weights = std::span(models.weights).subspan(models.choices(kind));
    for (auto& counts : choices) {
      const double coded = std::accumulate(counts.begin(), counts.end(), 0.);
      if (&counts > &choices[1 + kAlphaPlane]) counts.back() = std::max(0., tiles - coded);
      const auto stored = weights.first(counts.size());
      std::vector<double> prior;
      for (const std::uint8_t weight : stored) prior.push_back(SymbolModel::weight_of(weight));
      add_prior(prior, counts);
      store_weights(counts, stored);
      weights = weights.subspan(counts.size());
    }
  }
}

ColorMatrix fit_colors(const std::array<std::int64_t, 6>& products) {
  // How long the columns of YCbCr are, about, so that quantisation steps stay what they are.
  constexpr Vector kLengths{1.732, 1.7, 1.7};
  const auto at = [&](std::size_t k) { return static_cast<double>(products[k]); };
  const Matrix all{{{at(0), at(1), at(2)}, {at(1), at(3), at(4)}, {at(2), at(4), at(5)}}};
  const double trace = at(0) + at(3) + at(5);
  if (trace == 0) return kYcbcr;
  std::array<Vector, 3> axes;
  axes[0] = main_axis(all);
  // What is left of the others beside the first axis; a little of every direction, for grey fields.
  Matrix beside{}, left = all;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) beside[i][j] = (i == j ? 1 : 0) - axes[0][i] * axes[0][j];
  for (std::size_t i = 0; i < 3; ++i) left[i][i] += 1e-9 * trace;
  axes[1] = main_axis(product(product(beside, left), beside));
  for (std::size_t i = 0; i < 3; ++i)
    axes[2][i] =
        axes[0][(i + 1) % 3] * axes[1][(i + 2) % 3] - axes[0][(i + 2) % 3] * axes[1][(i + 1) % 3];
  ColorMatrix matrix;
  for (std::size_t column = 0; column < 3; ++column) {
    const Vector& axis = axes[column];
    const double sign = axis[0] + axis[1] + axis[2] < 0 ? -1 : 1;
    for (std::size_t row = 0; row < 3; ++row)
      matrix[3 * row + column] =
          static_cast<std::int16_t>(std::lround(256 * sign * kLengths[column] * axis[row]));
  }
  return matrix;
}

Result<Bytes> fit_tables(ByteSpan general, const EncodeSample& encode_sample) {
  auto tables = SLF_TRY(parse_predictive_tables(general));
  auto models = SLF_TRY(StoredModels::unpack(tables.models));
  std::mutex mutex;
  const auto encode = [&](bool few, auto&& observe) {
    const PredictiveCodec codec({}, tables, [&](const TileSymbols& tile) {
      const std::lock_guard lock(mutex);
      observe(tile);
    });
    return encode_sample(codec, few);
  };
  std::array<std::int64_t, 6> products{};
  SLF_TRY(encode(true, [&](const TileSymbols& tile) {
    // All tiles count alike: bits grow with the logarithm of differences, not with their squares.
    const std::int64_t squares = tile.colors[0] + tile.colors[3] + tile.colors[5];
    for (std::size_t k = 0; k < products.size() && squares > 0; ++k)
      products[k] += tile.colors[k] * (1 << 20) / squares;
  }));
  for (PredictiveLevel& level : tables.levels) level.matrix = fit_colors(products);
  std::vector<TilePart> parts;
  SLF_TRY(encode(false, [&](const TileSymbols& tile) { append_parts(tile, parts); }));

  auto weights = std::span(models.weights).subspan(models.choices(2));
  const auto fit = [&](ModelSets sets, bool of_alpha) {
    std::vector<const TilePart*> own;
    for (const TilePart& part : parts)
      if ((part.plane == kPlanes) == of_alpha) own.push_back(&part);
    std::vector<std::vector<double>> prior(sets.sets());
    for (std::size_t set = 0; set < sets.sets(); ++set) {
      sets.set_weights(set, weights.subspan(set * sets.symbols(), sets.symbols()));
      for (const std::uint8_t weight : sets.weights(set))
        prior[set].push_back(SymbolModel::weight_of(weight));
    }
    std::vector<std::size_t> group(own.size());
    for (int round = 0; round < kRounds; ++round) {
      for (std::size_t k = 0; k < own.size(); ++k) group[k] = sets.best(*own[k]).first;
      sets.fit(own, group, prior);
    }
    for (std::size_t set = 0; set < sets.sets(); ++set, weights = weights.subspan(sets.symbols()))
      std::ranges::copy(sets.weights(set), weights.begin());
    return sets;
  };
  const ModelSets alpha = fit(ModelSets(AlphaModels::kGroups, models.alpha_sets), true);
  const ModelSets blocks = fit(ModelSets(BlockModels::kGroups, models.block_sets), false);
  fit_choices(parts, alpha, blocks, models);
  tables.models = SLF_TRY(models.pack());
  return to_bytes(tables);
}

}  // namespace slf::codec
