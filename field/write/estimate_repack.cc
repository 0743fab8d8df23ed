#include <algorithm>
#include <cmath>

#include "base/mix.h"
#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/reference_index.h"
#include "field/write/repack_plan.h"
#include "field/write/write_budget.h"
#include "slf/repack.h"

namespace slf {
namespace {

using storage::TileState;

constexpr std::uint64_t kSample = 400;  // tiles that are encoded per level
constexpr double kDeviations = 1.96;    // of a 95 % confidence interval

// The bytes of a file besides payloads (FORMAT.md). For each tile: checksum, entry in the table,
// alignment. For records: headers, unused ends of pages, trees.
constexpr double kTileBytes = 14;
constexpr double kRecordShare = 0.004;
constexpr double kTreeBytes = 48 << 10;
constexpr double kFileUncertainty = 0.01;
// The bytes of its index: tables of records, references, and the pages of the trees.
constexpr double kIndexedTileBytes = 15;
constexpr double kIndexBytes = 24 << 10;

/// An estimated size and its variance.
struct Estimate {
  double bytes = 0, variance = 0, stored = 0;
  std::uint64_t sampled = 0;
  Estimate& operator+=(const Estimate& more) {
    bytes += more.bytes, variance += more.variance, stored += more.stored;
    sampled += more.sampled;
    return *this;
  }
};

/// The bytes of a tile's payload, predicted from tiles of the source; none if it is not stored.
Result<std::optional<std::uint64_t>> encoded_size(const TileSource& source, const TileCoder& coder,
                                                  TileKey key) {
  SourceTile tile;
  SLF_TRY(source.tile(key, tile));
  if (tile.ref.state != TileState::stored) return std::nullopt;
  const std::vector<TileKey> references = coder.choose(key, tile.samples);
  std::vector<SourceTile> tiles(references.size());
  std::vector<ReferenceSamples> from;
  for (std::size_t k = 0; k < references.size(); ++k) {
    SLF_TRY(source.tile(references[k], tiles[k]));
    from.push_back({references[k], tiles[k].samples});
  }
  Bytes payload;
  SLF_TRY(coder.encode(key, tile.samples, from, payload));
  return payload.size();
}

/// The exact size of copied tiles, from the tables of the records.
Result<Estimate> count(const Field& handle, const FieldShape& shape) {
  const FieldFile& field = handle.file();
  Estimate sum;
  const auto add = [&](const storage::TileRef& found) -> Result<void> {
    if (!shape.has(in_state(found.key, 0))) return {};
    const auto tile =
        SLF_TRY(found.state == TileState::same ? field.store().find(found.key) : found);
    if (tile.state != TileState::stored) return {};
    sum.bytes += static_cast<double>(tile.payload.size() - (field.coder().uses_states() ? 1 : 0));
    ++sum.stored;
    return {};
  };
  for (unsigned level = 0; level <= shape.levels; ++level) {
    const auto [begin, end] = keys_of(level, handle.state());
    SLF_TRY(field.store().visit(begin, end, add));
  }
  return sum;
}

/// Divides tiles into equal ranges, and estimates by encoding one tile of each.
Result<Estimate> sample(const TileSource& source, const TileCoder& coder, const TileOrder& order,
                        NumberRange tiles, unsigned threads, Reporter& progress) {
  const auto [begin, end] = tiles;
  const std::uint64_t count = end - begin, taken = std::min(count, kSample);
  const auto encode = [&](std::uint64_t k) {
    const std::uint64_t first = begin + count * k / taken, next = begin + count * (k + 1) / taken;
    return encoded_size(source, coder, order.key(first + mix(first) % (next - first)));
  };
  double sum = 0, squares = 0, stored = 0;
  const auto add = [&](std::uint64_t, std::optional<std::uint64_t> bytes) {
    const auto size = static_cast<double>(bytes.value_or(0));
    sum += size, squares += size * size, stored += bytes ? 1 : 0;
    return progress.add(1);
  };
  SLF_TRY(make_in_order(
      taken, threads, 4 * threads, [&] { return encode; }, add));
  const auto n = static_cast<double>(taken), all = static_cast<double>(count);
  Estimate estimate;
  estimate.sampled = taken;
  estimate.bytes = sum / n * all;
  estimate.stored = stored / n * all;
  if (taken < count && taken > 1)
    estimate.variance = all * all * (1 - n / all) * (squares - sum * sum / n) / (n - 1) / n;
  return estimate;
}

}  // namespace

Result<RepackEstimate> estimate_repack(const Field& handle, const RepackOptions& options,
                                       const ProgressCallback& progress) try {
  const StateSource state{"", handle};
  const auto plan = SLF_TRY(plan_repack({&state, 1}, options, 4 * cache_share(options.memory)));
  const FieldShape& shape = plan.manifest.shape;
  const TileOrder order(shape);
  Progress work;
  for (unsigned level = 0; !plan.copy && level <= shape.levels; ++level)
    work.total += std::min(kSample, shape.tiles(level));
  Reporter reporter(progress, work, "estimate interrupted");
  const auto codec =
      SLF_TRY(plan.codec(thread_count(options.threads), [&] { return reporter.go_on(); }));
  const TileCoder coder(shape, plan.manifest.format, *codec, plan.geometries());

  Estimate total;
  if (plan.copy) total = SLF_TRY(count(handle, shape));
  for (unsigned level = 0; !plan.copy && level <= shape.levels; ++level) {
    const auto estimate = SLF_TRY(at_place(sample(*plan.source, coder, order, order.level(level),
                                                  thread_count(options.threads), reporter),
                                           handle.path()));
    total += estimate;
  }
  std::uint64_t indexed = 0;
  for (unsigned level = 0; level <= shape.levels; ++level)
    if (shape.tiles(level) <= kMaxIndexedTiles) indexed += shape.tiles(level);
  const double error = kDeviations * std::sqrt(total.variance);
  double file = total.bytes * (1 + kRecordShare) + kTileBytes * total.stored +
                static_cast<double>(order.count()) + kTreeBytes +
                kIndexedTileBytes * static_cast<double>(indexed) + kIndexBytes +
                static_cast<double>(codec->tables().size());
  for (const auto& [name, bytes] : plan.kept) file += static_cast<double>(bytes.size());
  const auto whole = [](double bytes) { return static_cast<std::uint64_t>(std::llround(bytes)); };
  RepackEstimate estimate;
  estimate.tiles = order.count();
  estimate.sampled = total.sampled;
  estimate.payload_bytes = whole(total.bytes);
  estimate.payload_error_bytes = whole(error);
  estimate.file_bytes = whole(file);
  estimate.file_error_bytes = whole(error + kFileUncertainty * file + kTreeBytes / 2);
  estimate.input_bytes = handle.file_bytes();
  return estimate;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
