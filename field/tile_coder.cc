#include "field/tile_coder.h"

#include "base/half.h"
#include "codec/log_colors.h"
#include "codec/prediction.h"
#include "field/predict/predictor.h"

namespace slf {
namespace {

/// The fewest look-ups for which a tile becomes a reference. For fewer, reading it costs more than
/// it saves.
constexpr std::uint32_t kMinUses = 6;

}  // namespace

struct TileCoder::Relation {
  Relation(const TileCoder& coder, TileKey key)
      : coarser(coder.geometries_(key.level - 1u)),
        finer(coder.geometries_(key.level)),
        sections(sections_of(key, coder.shape_.entry_extra_levels)),
        rows(find_references(coarser, finer, sections.entry.index)),
        candidates(coarser, rows, sections, state_of(key)) {}

  /// Predicts the tile, and calls `code` with that. Colours of half floats are converted.
  template <class Code>
  Result<void> predict(std::span<const ReferenceSamples> from, bool half, const Code& code) const {
    std::vector<ReferenceTile> tiles(candidates.size());
    std::vector<std::uint8_t> used(candidates.size());
    std::vector<Bytes> converted;
    converted.reserve(from.size());
    for (const ReferenceSamples& one : from) {
      const auto k = candidates.find(one.reference);
      if (!k) continue;
      used[*k] = 1;
      if (one.samples.empty()) continue;
      const ByteSpan bytes =
          half ? converted.emplace_back(codec::to_rgba8_depth8(one.samples)) : one.samples;
      tiles[*k] = {bytes.data(), bytes.data() + bytes.size() / 5 * 4};
    }
    thread_local PredictedSamples predicted;
    TilePredictor(coarser, finer, sections, rows).predict(tiles, predicted);
    const codec::Predicted told{finer.level(), candidates.kinds(), used, predicted.view()};
    return code(&told);
  }

  const LevelGeometry& coarser;
  const LevelGeometry& finer;
  const TileSections sections;
  const References rows;
  const Candidates candidates;
};

std::vector<Reference> TileCoder::references(TileKey key, ByteSpan payload) const {
  std::vector<Reference> named;
  if (!predicts(key)) return named;
  const Relation to(*this, key);
  const auto used = codec_.references(key.level, to.candidates.kinds(), payload);
  for (std::size_t k = 0; k < used.size(); ++k)
    if (used[k]) named.push_back(to.candidates[k]);
  return named;
}

Result<void> TileCoder::decode(TileKey key, ByteSpan payload,
                               std::span<const ReferenceSamples> from,
                               std::span<std::byte> samples) const {
  const auto code = [&](const codec::Predicted* predicted) {
    return codec_.decode(tile_shape(key), payload, predicted, samples);
  };
  return predicts(key) ? Relation(*this, key).predict(from, is_half(format_), code) : code(nullptr);
}

std::vector<Reference> TileCoder::choose(TileKey key, ByteSpan samples) const {
  std::vector<Reference> chosen;
  if (!predicts(key) || samples.empty()) return chosen;
  const Relation to(*this, key);
  const std::size_t count = samples.size() / sample_bytes(format_), step = color_bytes(format_);
  std::vector<std::uint8_t> alpha(count), depth(count);
  for (std::size_t s = 0; s < count; ++s) {
    const std::byte* const color = &samples[s * step];
    alpha[s] = is_half(format_) ? byte_from_half(load_le<std::uint16_t>(color + 6))
                                : std::to_integer<std::uint8_t>(color[3]);
    depth[s] = std::to_integer<std::uint8_t>(samples[count * step + s]);
  }
  const auto uses = TilePredictor(to.coarser, to.finer, to.sections, to.rows).uses(alpha, depth);
  for (std::size_t k = 0; k < uses.size(); ++k)
    if (uses[k] >= kMinUses && shape_.has(to.candidates[k].tile))
      chosen.push_back(to.candidates[k]);
  return chosen;
}

Result<void> TileCoder::encode(TileKey key, ByteSpan samples,
                               std::span<const ReferenceSamples> from, Bytes& payload) const {
  const auto code = [&](const codec::Predicted* predicted) {
    return codec_.encode(tile_shape(key), samples, predicted, payload);
  };
  if (!predicts(key)) return code(nullptr);
  std::vector<ReferenceSamples> visible(from.begin(), from.end());
  std::erase_if(visible, [](const ReferenceSamples& one) { return one.samples.empty(); });
  return Relation(*this, key).predict(visible, is_half(format_), code);
}

}  // namespace slf
