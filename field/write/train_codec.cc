#include "field/write/train_codec.h"

#include <algorithm>
#include <map>
#include <vector>

#include "base/mix.h"
#include "base/parallel.h"
#include "base/try.h"
#include "codec/predictive_training.h"
#include "field/geometry/tile_order.h"

namespace slf {
namespace {

using storage::TileState;

/// Tries to find the tiles that a codec is fitted to that does not predict.
constexpr std::uint64_t kTrainingTries = 256;
/// One that predicts is fitted to runs of tiles that follow each other, which are predicted from
/// nearly the same coarser ones.
constexpr std::uint64_t kRunTiles = 16;
/// At most one of so many tiles of the finest level is made for that.
constexpr std::uint64_t kShare = 16;
/// The tables of smaller fields are not fitted: that would gain little.
constexpr std::uint64_t kLeastSamples = 8 << 20;

tl::unexpected<Error> interrupted() {
  return fail(ErrorCode::cancelled, "interrupted; nothing was written");
}

/// Encodes a run of tiles, each predicted from tiles of `coarser`.
Result<void> encode_run(const TileSource& source, const TileSource& coarser, const TileCoder& coder,
                        const TileOrder& order, NumberRange run) {
  std::map<TileKey, SourceTile> references;
  SourceTile tile;
  Bytes payload;
  for (std::uint64_t n = run.begin; n < run.end; ++n) {
    const TileKey key = order.key(n);
    SLF_TRY(source.tile(key, tile));
    if (tile.ref.state != TileState::stored) continue;
    std::vector<ReferenceSamples> from;
    for (const TileKey reference : coder.choose(key, tile.samples)) {
      const auto [found, added] = references.try_emplace(reference);
      if (added) SLF_TRY(coarser.tile(reference, found->second));
      if (found->second.ref.state == TileState::stored)
        from.push_back({reference, found->second.samples});
    }
    SLF_TRY(coder.encode(key, tile.samples, from, payload));
  }
  return {};
}

}  // namespace

Result<std::unique_ptr<codec::Codec>> train_codec(const TileSource& source,
                                                  const TileCoder::Geometries& geometries,
                                                  const Manifest& manifest, unsigned threads,
                                                  const GoOn& go_on, std::uint64_t runs) {
  const FieldShape shape = one_state(manifest.shape);
  const TileOrder order(shape);
  const NumberRange finest = order.level(shape.finest_level);
  const std::size_t wanted = codec::needs_training(manifest.codec) ? codec::kTrainingTiles : 0;
  std::vector<SourceTile> sample;
  for (std::uint64_t t = 0;; ++t) {
    if (!go_on()) return interrupted();
    if (t == kTrainingTries || sample.size() == wanted) break;
    SourceTile tile;
    SLF_TRY(source.tile(order.key(finest.begin + mix(t) % finest.count()), tile));
    if (tile.ref.state == TileState::stored) sample.push_back(std::move(tile));
  }
  std::vector<codec::TrainingTile> tiles;
  for (const SourceTile& tile : sample) {
    const auto sections = sections_of(tile.ref.key, shape.entry_extra_levels);
    tiles.push_back(
        {geometries(shape.finest_level).tile(sections.entry.index, manifest.format), tile.samples});
  }
  auto general =
      SLF_TRY(codec::train_codec(manifest.codec, manifest.format, tiles, shape.finest_level));
  runs = std::min(runs, finest.count() / (kRunTiles * kShare));
  if (!general->four_taps() || runs == 0 ||
      finest.count() * shape.max_tile_samples() < kLeastSamples)
    return general;

  // Coarser tiles are not predicted themselves: that would take their references, too.
  const TileCoder general_coder(shape, manifest.format, *general, geometries);
  const CodedTiles coarser(source, general_coder);
  const auto encode_sample = [&](const codec::Codec& codec, bool few) {
    const TileCoder coder(shape, manifest.format, codec, geometries);
    const std::uint64_t every = few ? 4 : 1;
    const auto encode = [&](std::uint64_t k) -> Result<bool> {
      const std::uint64_t run = k * every, part = finest.count() / runs;
      const std::uint64_t within = mix(run) % (part / kRunTiles);
      const std::uint64_t first = finest.begin + run * part + within * kRunTiles;
      SLF_TRY(encode_run(source, coarser, coder, order, {first, first + kRunTiles}));
      return true;
    };
    return make_in_order(
        (runs + every - 1) / every, threads, threads, [&] { return encode; },
        [&](std::uint64_t, bool) { return go_on() ? Result<void>() : interrupted(); });
  };
  const Bytes fitted = SLF_TRY(codec::fit_tables(general->tables(), encode_sample));
  return codec::make_codec(manifest.codec, manifest.format, fitted);
}

}  // namespace slf
