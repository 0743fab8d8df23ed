#include "field/predicted_tiles.h"

#include <cstring>
#include <optional>

#include "field/predict/predictor.h"

namespace slf {
namespace {

/// Look-ups that make a tile worth its while: reading one for fewer costs more than it saves.
constexpr std::uint32_t kFewestUses = 24;

/// What a sample is predicted as where there is nothing to predict it from.
constexpr std::uint8_t kMiddle = 128;
constexpr std::uint32_t kGray = 0xFF808080u;

}  // namespace

/// The tiles that a tile may refer to: none at level 0.
struct Candidates {
  References references;
  std::vector<TileSections> sections;
  std::vector<TileKey> keys;
  std::vector<std::uint8_t> kinds;

  Candidates(const PredictedTiles::Geometries& geometries, unsigned level,
             const TileSections& tile) {
    if (level == 0) return;
    const LevelGeometry& coarser = geometries(level - 1);
    references = find_references(coarser, geometries(level), tile.entry.index);
    sections = candidates_of(coarser, references);
    for (const TileSections& candidate : sections) {
      keys.push_back(tile_key(candidate));
      const bool far_entry = candidate.entry != tile.entry.parent();
      const bool far_exit = candidate.exit.octant() != tile.exit.octant();
      kinds.push_back(static_cast<std::uint8_t>((far_entry ? 2 : 0) + (far_exit ? 1 : 0)));
    }
  }
};

/// What both directions begin with.
struct PredictedTiles::Work {
  codec::Tile tile;
  const codec::TilePicture& picture;
  const codec::PredictiveLevel& level;
  std::size_t samples;
  Candidates candidates;
  std::optional<TilePredictor> predictor;  // none at level 0
  std::vector<std::uint8_t> alpha, depth;  // predicted, then decoded
  std::vector<std::uint32_t> color;        // predicted
  std::vector<TileSamples> kept;
  std::vector<ReferenceTile> from;

  Work(const PredictedTiles& tiles, TileKey key)
      : Work(tiles, key, sections_of(key, tiles.shape_.entry_extra_levels)) {}
  Work(const PredictedTiles& tiles, TileKey key, const TileSections& sections)
      : tile(tiles.geometries_(key.level).tile(sections.entry.index, SampleFormat::rgba8_depth8)),
        picture(tiles.codec_.picture(tile)),
        level(tiles.codec_.level(key.level)),
        samples(tile.rows() * tile.columns()),
        candidates(tiles.geometries_, key.level, sections),
        alpha(samples, 0),
        depth(samples, kMiddle),
        color(samples, kGray) {
    if (key.level == 0) return;
    predictor.emplace(tiles.geometries_(key.level - 1u), tiles.geometries_(key.level), sections,
                      std::move(candidates.references));
    from.resize(candidates.keys.size());
  }

  /// Makes candidate `k` a reference; of a tile where nothing is visible there is nothing to use.
  Result<bool> use(std::size_t k, const LevelGeometry& coarser, const ReferenceSource& source) {
    auto found = source(candidates.keys[k]);
    if (!found) return tl::unexpected(found.error());
    if (!*found) return false;
    const std::uint32_t entry = candidates.sections[k].entry.index;
    const codec::Tile shape = coarser.tile(entry, SampleFormat::rgba8_depth8);
    const std::byte* const color_of = (*found)->data();
    from[k] = {color_of, color_of + 4 * shape.rows() * shape.columns()};
    kept.push_back(std::move(*found));
    return true;
  }
};

std::vector<TileKey> PredictedTiles::references(TileKey key, ByteSpan payload) const {
  std::vector<TileKey> keys;
  if (key.level == 0) return keys;
  const TileSections sections = sections_of(key, shape_.entry_extra_levels);
  const Candidates candidates(geometries_, key.level, sections);
  const codec::Tile tile =
      geometries_(key.level).tile(sections.entry.index, SampleFormat::rgba8_depth8);
  codec::PredictiveDecoder decoder(codec_.level(key.level), codec_.picture(tile), payload);
  std::vector<std::uint8_t> used(candidates.keys.size());
  decoder.references(candidates.kinds, used);
  for (std::size_t k = 0; k < used.size(); ++k)
    if (used[k]) keys.push_back(candidates.keys[k]);
  return keys;
}

Result<void> PredictedTiles::decode(TileKey key, ByteSpan payload, const ReferenceSource& source,
                                    std::span<std::byte> samples) const {
  Work work(*this, key);
  codec::PredictiveDecoder decoder(work.level, work.picture, payload);
  std::vector<std::uint8_t> used(work.candidates.keys.size());
  decoder.references(work.candidates.kinds, used);
  for (std::size_t k = 0; k < used.size(); ++k)
    if (used[k])
      if (auto ok = work.use(k, geometries_(key.level - 1u), source); !ok)
        return tl::unexpected(ok.error());
  if (work.predictor) work.predictor->alpha_depth(work.from, work.alpha, work.depth);
  decoder.alpha_depth(work.alpha, work.depth);
  if (work.predictor) work.predictor->color(work.from, work.alpha, work.depth, work.color);
  std::vector<std::uint32_t> rgba(work.samples);
  decoder.color(work.alpha, work.color, rgba);
  for (std::size_t s = 0; s < work.samples; ++s) store_le(samples.data() + 4 * s, rgba[s]);
  std::memcpy(samples.data() + 4 * work.samples, work.depth.data(), work.samples);
  return decoder.finish();
}

Result<void> PredictedTiles::encode(TileKey key, ByteSpan samples, const ReferenceSource& source,
                                    Bytes& payload, codec::BitCounts* counts) const {
  payload.clear();
  Work work(*this, key);
  std::vector<std::uint32_t> rgba(work.samples);
  std::vector<std::uint8_t> true_alpha(work.samples), true_depth(work.samples);
  for (std::size_t s = 0; s < work.samples; ++s) {
    rgba[s] = load_le<std::uint32_t>(samples.data() + 4 * s);
    true_alpha[s] = static_cast<std::uint8_t>(rgba[s] >> 24);
    true_depth[s] = std::to_integer<std::uint8_t>(samples[4 * work.samples + s]);
  }
  codec::PredictiveEncoder encoder(work.level, work.picture, payload);
  encoder.count(counts);
  if (work.predictor) {
    const auto uses = work.predictor->uses(true_alpha, true_depth);
    std::vector<std::uint8_t> used(uses.size());
    for (std::size_t k = 0; k < uses.size(); ++k) {
      if (uses[k] < kFewestUses || !shape_.has(work.candidates.keys[k])) continue;
      const auto has = work.use(k, geometries_(key.level - 1u), source);
      if (!has && has.error().code != ErrorCode::failed) return tl::unexpected(has.error());
      used[k] = has && *has ? 1 : 0;
    }
    encoder.references(work.candidates.kinds, used);
    work.predictor->alpha_depth(work.from, work.alpha, work.depth);
  } else {
    encoder.references({}, {});
  }
  encoder.alpha_depth(true_alpha, true_depth, work.alpha, work.depth);
  if (work.predictor) work.predictor->color(work.from, work.alpha, work.depth, work.color);
  encoder.color(work.alpha, work.color, rgba);
  encoder.finish();
  // A payload of no bytes would mean an empty tile.
  if (payload.empty()) payload.push_back(std::byte{0});
  return {};
}

}  // namespace slf
