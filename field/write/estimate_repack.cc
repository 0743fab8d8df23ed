#include <algorithm>
#include <cmath>

#include "base/mix.h"
#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/geometry/tile_order.h"
#include "field/reference_index.h"
#include "field/write/repack_plan.h"
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

/// Encodes tiles of the output.
class SampleEncoder {
 public:
  SampleEncoder(TileCache& tiles, const RepackPlan& plan)
      : field_(tiles.field()),
        tiles_(tiles),
        plan_(plan),
        coder_(plan.shape, plan.format, *plan.codec,
               [this](unsigned level) -> const LevelGeometry& { return field_.geometry(level); }) {}

  /// The bytes of a tile's payload; none if it is not stored.
  [[nodiscard]] Result<std::optional<std::uint64_t>> encode(TileKey key) const {
    Bytes samples, payload;
    const bool is_stored = SLF_TRY(read(key, samples));
    if (!is_stored) return std::nullopt;
    std::vector<Bytes> kept;
    std::vector<ReferenceSamples> from;
    for (const TileKey reference : coder_.choose(key, samples)) {
      const bool has_samples = SLF_TRY(read(reference, kept.emplace_back()));
      if (has_samples) from.push_back({reference, kept.back()});
    }
    SLF_TRY(coder_.encode(key, samples, from, payload));
    return payload.size();
  }

 private:
  /// False: the tile, or one that it is predicted from, is not stored.
  [[nodiscard]] Result<bool> read(TileKey key, Bytes& samples) const {
    const auto tile = SLF_TRY(field_.store().find(key));
    if (tile.state != TileState::stored) return false;
    const auto ok = convert_samples(tiles_, plan_, key, samples);
    if (!ok && ok.error().code != ErrorCode::tile_missing) return tl::unexpected(ok.error());
    return ok.has_value();
  }

  const FieldFile& field_;
  TileCache& tiles_;
  const RepackPlan& plan_;
  TileCoder coder_;
};

/// The exact size of copied tiles, from the tables of the records.
Result<Estimate> count(const FieldFile& field, const FieldShape& shape) {
  Estimate sum;
  const TileRange all = all_keys(shape);
  SLF_TRY(
      field.store().visit(all.begin, all.end, [&](const storage::TileRef& tile) -> Result<void> {
        if (!shape.has(tile.key)) return {};
        sum.bytes += static_cast<double>(tile.payload.size());
        if (tile.state == TileState::stored && field.coder().uses_states()) --sum.bytes;
        sum.stored += tile.state == TileState::stored ? 1 : 0;
        return {};
      }));
  return sum;
}

/// Divides the tiles [begin, end) into equal ranges, and estimates by encoding one tile of each.
Result<Estimate> sample(const SampleEncoder& encoder, const TileOrder& order, std::uint64_t begin,
                        std::uint64_t end, unsigned threads, Reporter& progress) {
  const std::uint64_t count = end - begin, taken = std::min(count, kSample);
  const auto encode = [&](std::uint64_t k) {
    const std::uint64_t first = begin + count * k / taken, next = begin + count * (k + 1) / taken;
    return encoder.encode(order.key(first + mix(first) % (next - first)));
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
                                       const ProgressCallback& progress) {
  SLF_TRY(check_not_composed(handle));
  const FieldFile& field = handle.file();
  TileCache tiles(field, options.memory / 3);
  const auto plan = SLF_TRY(plan_repack(tiles, options));
  const FieldShape& shape = plan.shape;
  const TileOrder order(shape);
  Progress work;
  for (unsigned level = 0; !plan.copy && level <= shape.levels; ++level)
    work.total += std::min(kSample, shape.tiles(level));
  Reporter reporter(progress, work, "estimate interrupted");

  Estimate total;
  if (plan.copy) total = SLF_TRY(count(field, shape));
  const SampleEncoder encoder(tiles, plan);
  for (unsigned level = 0; !plan.copy && level <= shape.levels; ++level) {
    const auto estimate = SLF_TRY(
        at_place(sample(encoder, order, order.first_number(level), order.first_number(level + 1),
                        thread_count(options.threads), reporter),
                 field.path()));
    total += estimate;
  }
  const ByteSpan light = SLF_TRY(kept_light(field, options));
  std::uint64_t indexed = 0;
  for (unsigned level = 0; level <= shape.levels; ++level)
    if (shape.tiles(level) <= kMaxIndexedTiles) indexed += shape.tiles(level);
  const double error = kDeviations * std::sqrt(total.variance);
  const double file = total.bytes * (1 + kRecordShare) + kTileBytes * total.stored +
                      static_cast<double>(order.count()) + kTreeBytes +
                      kIndexedTileBytes * static_cast<double>(indexed) + kIndexBytes +
                      static_cast<double>(plan.codec->tables().size() + light.size());
  const auto whole = [](double bytes) { return static_cast<std::uint64_t>(std::llround(bytes)); };
  RepackEstimate estimate;
  estimate.tiles = order.count();
  estimate.sampled = total.sampled;
  estimate.payload_bytes = whole(total.bytes);
  estimate.payload_error_bytes = whole(error);
  estimate.file_bytes = whole(file);
  estimate.file_error_bytes = whole(error + kFileUncertainty * file + kTreeBytes / 2);
  return estimate;
}

}  // namespace slf
