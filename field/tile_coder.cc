#include "field/tile_coder.h"

#include <optional>

#include "base/try.h"
#include "codec/log_colors.h"
#include "codec/prediction.h"
#include "field/predict/predictor.h"

namespace slf {
namespace {

/// The fewest look-ups for which a tile becomes a reference. For fewer, reading it costs more than
/// it saves.
constexpr std::uint32_t kMinUses = 6;

}  // namespace

/// Predicts a tile of a level above 0.
class TileCoder::Predictor final : public codec::Predictor {
 public:
  Predictor(const TileCoder& tiles, TileKey key, const ReferenceSource& source)
      : tiles_(tiles),
        level_(key.level),
        sections_(sections_of(key, tiles.shape_.entry_extra_levels)),
        source_(source),
        references_(find_references(coarser(), finer(), sections_.entry.index)) {
    for (const TileSections& candidate : candidates_of(coarser(), references_)) {
      keys_.push_back(tile_key(candidate));
      const bool far_entry = candidate.entry != sections_.entry.parent();
      const bool far_exit = candidate.exit.octant() != sections_.exit.octant();
      kinds_.push_back(static_cast<std::uint8_t>((far_entry ? 2 : 0) + (far_exit ? 1 : 0)));
    }
    from_.resize(keys_.size());
  }

  unsigned level() const override { return level_; }
  std::span<const std::uint8_t> kinds() const override { return kinds_; }
  /// The candidates' keys.
  const std::vector<TileKey>& keys() const { return keys_; }

  Result<std::vector<std::uint8_t>> choose(std::span<const std::uint8_t> alpha,
                                           std::span<const std::uint8_t> depth) override {
    std::vector<std::uint8_t> used(keys_.size());
    const auto uses = predictor().uses(alpha, depth);
    for (std::size_t k = 0; k < uses.size(); ++k) {
      if (uses[k] < kMinUses || !tiles_.shape_.has(keys_[k])) continue;
      const auto loaded = load(k);
      if (!loaded && loaded.error().code != ErrorCode::tile_missing)
        return tl::unexpected(loaded.error());
      used[k] = from_[k].color ? 1 : 0;
    }
    return used;
  }

  Result<codec::Prediction> predict(std::span<const std::uint8_t> used) override {
    for (std::size_t k = 0; k < used.size(); ++k)
      if (used[k] && !from_[k].color) SLF_TRY(load(k));
    // Only now: loading may decode other tiles on this thread.
    thread_local PredictedSamples predicted;
    predictor().predict(from_, predicted);
    return predicted.view();
  }

 private:
  const LevelGeometry& coarser() const { return tiles_.geometries_(level_ - 1); }
  const LevelGeometry& finer() const { return tiles_.geometries_(level_); }

  const TilePredictor& predictor() {
    if (!predictor_) predictor_.emplace(coarser(), finer(), sections_, std::move(references_));
    return *predictor_;
  }

  /// Loads candidate `k`. If its tile is empty, it predicts nothing.
  Result<void> load(std::size_t k) {
    ByteSpan samples = SLF_TRY(source_(keys_[k]));
    if (samples.empty()) return {};
    if (is_half(tiles_.format_)) samples = converted_.emplace_back(codec::to_rgba8_depth8(samples));
    from_[k] = {samples.data(), samples.data() + samples.size() / 5 * 4};
    return {};
  }

  const TileCoder& tiles_;
  const unsigned level_;
  const TileSections sections_;
  const ReferenceSource& source_;
  References references_;  // until predictor_ has them
  std::vector<TileKey> keys_;
  std::vector<std::uint8_t> kinds_;
  std::optional<TilePredictor> predictor_;
  std::vector<ReferenceTile> from_;
  std::vector<Bytes> converted_;  // from half floats; what from_ views
};

std::vector<TileKey> TileCoder::references(TileKey key, ByteSpan payload) const {
  std::vector<TileKey> keys;
  if (!predicts() || key.level == 0) return keys;
  const ReferenceSource none;
  const Predictor predictor(*this, key, none);
  const auto used = codec_.references(predictor, payload);
  for (std::size_t k = 0; k < used.size(); ++k)
    if (used[k]) keys.push_back(predictor.keys()[k]);
  return keys;
}

Result<void> TileCoder::decode(TileKey key, ByteSpan payload, const ReferenceSource& source,
                               std::span<std::byte> samples) const {
  std::optional<Predictor> predictor;
  if (predicts() && key.level > 0) predictor.emplace(*this, key, source);
  return codec_.decode(tile_shape(key), payload, predictor ? &*predictor : nullptr, samples);
}

Result<void> TileCoder::encode(TileKey key, ByteSpan samples, const ReferenceSource& source,
                               Bytes& payload) const {
  std::optional<Predictor> predictor;
  if (predicts() && key.level > 0) predictor.emplace(*this, key, source);
  return codec_.encode(tile_shape(key), samples, predictor ? &*predictor : nullptr, payload);
}

}  // namespace slf
