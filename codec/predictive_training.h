// Fits the tables of the predictive codec to tiles: the models to their symbols, and the colour
// matrix to their colours. Sums are in integers, so tables do not depend on the order of tiles.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "codec/codec.h"
#include "codec/predictive.h"

namespace slf::codec {

/// A part of a tile that chooses a set of models: its levels of alpha, or a plane of blocks.
struct TilePart {
  struct Symbol {
    std::uint16_t model, value;
    std::uint32_t count;
  };
  std::size_t level_kind = 0;
  std::size_t plane = 0;  ///< kPlanes: levels of alpha
  std::vector<Symbol> symbols;
  std::uint64_t even_bits = 0, total = 0;  ///< bits without a model; symbols with one
};

/// Adds the parts of a tile.
void append_parts(const TileSymbols& tile, std::vector<TilePart>& parts);

/// Sets of models of one kind that are fitted to parts of tiles, as stored weights.
class ModelSets {
 public:
  ModelSets(std::span<const ModelGroup> groups, std::size_t sets);

  /// Each set is that of its `group` of parts. What these have hardly shown is as in `prior`, the
  /// counts of all symbols in each set.
  void fit(std::span<const TilePart* const> parts, std::span<const std::size_t> group,
           std::span<const std::vector<double>> prior);
  /// How often each symbol occurs in the parts of each set.
  [[nodiscard]] std::vector<std::vector<double>> counts(std::span<const TilePart* const> parts,
                                                        std::span<const std::size_t> group) const;
  /// The set that codes a part in the fewest bits, and these, in 1/65536.
  [[nodiscard]] std::pair<std::size_t, std::uint64_t> best(const TilePart& part) const;

  [[nodiscard]] std::size_t sets() const { return weights_.size(); }
  /// Of all symbols of a set.
  [[nodiscard]] std::span<const std::uint8_t> weights(std::size_t set) const {
    return weights_[set];
  }
  void set_weights(std::size_t set, std::span<const std::uint8_t> weights);
  /// The index of a symbol in the weights of a set.
  [[nodiscard]] std::size_t index(const TilePart::Symbol& symbol) const {
    return first_[symbol.model] + symbol.value;
  }
  [[nodiscard]] std::size_t symbols() const { return first_.back(); }

 private:
  std::vector<std::size_t> first_;  // symbol of each model, and their number
  std::vector<std::vector<std::uint8_t>> weights_;
  std::vector<std::vector<std::uint32_t>> bits_;
};

/// The stored weights of a model that is as near to `counts` as possible.
void store_weights(std::span<const double> counts, std::span<std::uint8_t> weights);

/// Fits the choices of sets to what parts choose, beside what they are.
void fit_choices(std::span<const TilePart> parts, const ModelSets& alpha, const ModelSets& blocks,
                 StoredModels& models);

/// The axes of colours whose differences from the prediction have these sums of products, the one
/// along which they differ most first; YCbCr if there is no difference.
[[nodiscard]] ColorMatrix fit_colors(const std::array<std::int64_t, 6>& products);

/// Encodes some tiles of a field, on any threads; if `few` is true, fewer will do.
using EncodeSample = std::function<Result<void>(const Codec&, bool few)>;

/// Tables fitted to a field, from general ones of blocks.
[[nodiscard]] Result<Bytes> fit_tables(ByteSpan general, const EncodeSample& encode_sample);

}  // namespace slf::codec
