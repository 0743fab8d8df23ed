#include "slf/repack.h"

#include <algorithm>
#include <filesystem>

#include "base/parallel.h"
#include "base/sort_unique.h"
#include "base/try.h"
#include "field/build/field_writer.h"
#include "field/build/repack_layers.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"

namespace slf {
namespace {

using storage::LayerId;
using storage::TileState;

constexpr std::uint64_t kAdvised = 64;  // tiles per call of advise()

/// An encoded tile, for the writer.
struct RecodedTile {
  std::vector<Bytes> payloads;
  std::vector<TileState> states;
};

/// Makes a tile of the output. If tiles are predicted, `coarser` has the levels written before.
Result<RecodedTile> recode(const FieldFile& field, const FieldFile* coarser,
                           const std::vector<OutputLayer>& outputs, TileKey key, InputTile& input,
                           Bytes& samples) {
  RecodedTile tile;
  input.begin(key);
  for (std::size_t k = 0; k < outputs.size(); ++k) {
    const OutputLayer& out = outputs[k];
    Bytes& payload = tile.payloads.emplace_back();
    const auto state = SLF_TRY(state_of(field, out, key));
    tile.states.push_back(state);
    if (state != TileState::stored) continue;
    if (out.copy) {
      const auto found = SLF_TRY(field.store().find(out.from[0], key));
      SLF_TRY(field.store().check(found));
      payload.assign(found.payload.begin(), found.payload.end());
      continue;
    }
    auto ok = input.samples(field, out, samples);
    if (!ok && ok.error().code == ErrorCode::tile_missing) {  // it is predicted from a missing tile
      tile.states.back() = TileState::missing;
      continue;
    }
    codec::Tile shape = field.tile_shape(out.from[0], key);
    shape.format = out.layer.format;
    if (ok)
      ok = coarser && out.codec->predictive()
               ? coarser->encode(static_cast<LayerId>(k), key, samples, payload)
               : out.codec->encode(shape, samples, payload);
    if (!ok) return tl::unexpected(ok.error());
  }
  return tile;
}

/// Prefetches the tiles with numbers in [begin, end), for an input that is not in memory.
void advise(const FieldFile& field, const std::vector<OutputLayer>& outputs, const TileOrder& order,
            std::uint64_t begin, std::uint64_t end) {
  std::vector<TileKey> keys;
  for (std::uint64_t n = begin; n < std::min(end, order.count()); ++n) keys.push_back(order.key(n));
  std::vector<LayerId> layers;
  for (const OutputLayer& out : outputs)
    layers.insert(layers.end(), out.from.begin(), out.from.end());
  sort_unique(layers);
  for (const LayerId layer : layers) {
    std::vector<storage::TileRef> tiles;
    for (const auto& tile : field.store().find_all(layer, keys))
      if (tile) tiles.push_back(*tile);
    field.advise(tiles);
  }
}

/// Writes the tiles of an output.
class Repacker {
 public:
  Repacker(const FieldFile& field, const FieldShape& shape, const std::vector<OutputLayer>& outputs,
           const RepackOptions& options, FieldWriter& writer, const ProgressCallback& progress,
           RepackReport& report)
      : field_(field),
        outputs_(outputs),
        writer_(writer),
        progress_(progress),
        report_(report),
        order_(shape) {
    // A third of the budget is for tiles in progress, each at most decoded twice and encoded once
    // per layer; a third for records waiting for their commit; a third for LMDB's copies of their
    // pages. With predicted tiles, half of the first third caches the tiles that others are
    // predicted from, of the input and of the output.
    predicts_ = std::any_of(outputs.begin(), outputs.end(), [](const OutputLayer& out) {
      return out.codec->predictive() && !out.copy;
    });
    const std::uint64_t share = options.memory / 3;
    references_ = share / 4;
    field.set_reference_budget(references_);
    writer.set_pending_limit(share);
    const std::uint64_t under_way = field.predicts() || predicts_ ? share / 2 : share;
    const std::uint64_t tile_cost = shape.max_tile_samples() * 24 + 4096;
    threads_ = static_cast<unsigned>(
        std::clamp<std::uint64_t>(under_way / tile_cost, 1, thread_count(options.threads)));
    window_ = std::clamp<std::uint64_t>(under_way / tile_cost, 1, 8 * threads_);
    state_.total = order_.count();
  }

  Result<void> write() {
    for (std::uint64_t begin = 0, end = 0; begin < order_.count(); begin = end) {
      end = order_.count();
      std::shared_ptr<const FieldFile> written;
      if (predicts_) {  // level by level: each is predicted from the one written before
        end = order_.first_number(order_.key(begin).level + 1u);
        SLF_TRY(writer_.commit_level());
        written = SLF_TRY(FieldFile::open(writer_.file()));
        written->set_reference_budget(references_);
      }
      SLF_TRY(write(begin, end, written.get()));
    }
    return writer_.finish([&] { return !progress_ || progress_(state_); });
  }

 private:
  /// Recodes the tiles with numbers in [begin, end) on all threads and appends them in order.
  Result<void> write(std::uint64_t begin, std::uint64_t end, const FieldFile* coarser) {
    OrderedPipeline<RecodedTile> pipeline(end - begin, threads_, window_, [&] {
      return [&, input = InputTile(), samples = Bytes()](std::uint64_t n) mutable {
        return recode(field_, coarser, outputs_, order_.key(begin + n), input, samples);
      };
    });
    advise(field_, outputs_, order_, begin, begin + window_ + kAdvised);
    for (std::uint64_t n = begin; n < end; ++n) {
      if ((n - begin) % kAdvised == 0) {
        field_.store().release_all();  // pages that were read stay in the kernel's cache
        advise(field_, outputs_, order_, n + window_ + kAdvised, n + window_ + 2 * kAdvised);
      }
      RecodedTile tile = SLF_TRY(pipeline.take());
      SLF_TRY(put(order_.key(n), std::move(tile)));
      ++state_.done;
      if (progress_ && !progress_(state_))
        return fail(ErrorCode::cancelled, field_.path(),
                    ": repack interrupted; nothing was written");
    }
    return {};
  }

  Result<void> put(TileKey key, RecodedTile tile) {
    for (std::size_t k = 0; k < tile.payloads.size(); ++k) {
      if (tile.states[k] == TileState::missing) {
        ++report_.missing;
        if (field_.manifest().holds(key))
          SLF_TRY(writer_.put_missing(static_cast<LayerId>(k), key));
        continue;
      }
      ++report_.tiles;
      ++(outputs_[k].copy ? report_.copied : report_.recoded);
      report_.payload_bytes += tile.payloads[k].size();
      SLF_TRY(writer_.put(static_cast<LayerId>(k), key, std::move(tile.payloads[k])));
    }
    return {};
  }

  const FieldFile& field_;
  const std::vector<OutputLayer>& outputs_;
  FieldWriter& writer_;
  const ProgressCallback& progress_;
  RepackReport& report_;
  TileOrder order_;
  Progress state_;
  bool predicts_ = false;
  std::uint64_t references_ = 0;
  unsigned threads_ = 1;
  std::size_t window_ = 1;
};

}  // namespace

Result<RepackReport> repack_field(const Field& handle, const std::string& path,
                                  const RepackOptions& options, const ProgressCallback& progress) {
  const FieldFile& field = handle.file();
  const auto output = SLF_TRY(FieldOutput::at(
      path, options.replace ? Existing::replace : Existing::keep, std::span(&field.path(), 1)));
  Manifest manifest = field.manifest();
  auto shape = SLF_TRY(plan_shape(field, options));
  manifest.shape = std::move(shape);
  // If the finest level is left out, the next one becomes the finest: record that it is filtered.
  manifest.filtered_levels = field.manifest().filtered_levels.value_or(field.shape().levels);
  const auto outputs = SLF_TRY(plan_layers(field, manifest.shape, options));
  std::vector<ByteSpan> tables;
  manifest.layers.clear();
  for (const OutputLayer& out : outputs) {
    manifest.layers.push_back(out.layer);
    tables.push_back(out.codec->tables());
  }
  if (progress && !progress({0, TileOrder(manifest.shape).count(), 0}))
    return fail(ErrorCode::cancelled, field.path(), ": repack interrupted; nothing was written");
  const Result<ByteSpan> light = options.light ? field.light() : ByteSpan();
  if (!light)
    return fail(light.error().code, light.error().message, "; a copy can leave the light out");
  auto writer =
      SLF_TRY(FieldWriter::create(output, FieldWriter::Draft::discard, manifest, tables, *light));

  RepackReport report;
  Repacker repacker(field, manifest.shape, outputs, options, writer, progress, report);
  SLF_TRY(repacker.write());
  std::error_code ignored;
  report.file_bytes = std::filesystem::file_size(output.target, ignored);
  return report;
}

}  // namespace slf
