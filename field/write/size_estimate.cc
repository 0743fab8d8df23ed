#include "field/write/size_estimate.h"

#include <time.h>

#include <algorithm>
#include <cmath>

#include "base/mix.h"
#include "base/parallel.h"
#include "base/try.h"
#include "field/reference_index.h"

namespace slf {
namespace {

using storage::TileState;

constexpr double kDeviations = 1.96;  // of a 95 % confidence interval

// The bytes of a file besides payloads (FORMAT.md). For each tile: checksum, entry in the table,
// alignment. For records: headers, unused ends of pages, trees.
constexpr double kTileBytes = 14;
constexpr double kRecordShare = 0.004;
constexpr double kTreeBytes = 48 << 10;
constexpr double kFileUncertainty = 0.01;
// The bytes of its index: tables of records, references, and the pages of the trees.
constexpr double kIndexedTileBytes = 15;
constexpr double kIndexBytes = 24 << 10;

/// Of this thread, on a processor.
double thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

struct SampledTile {
  std::uint64_t bytes = 0;
  bool stored = false;
  double seconds = 0;  ///< without those of the tiles that it is predicted from
};

/// Whether an earlier state has the same samples.
Result<bool> is_repeated(const TileSource& source, const SourceTile& tile) {
  SourceTile earlier;
  for (unsigned state = 0; state < tile.ref.key.state; ++state) {
    SLF_TRY(source.tile(in_state(tile.ref.key, state), earlier));
    if (earlier.ref.state == TileState::stored && earlier.samples == tile.samples) return true;
  }
  return false;
}

Result<SampledTile> encode_sample(const TileSource& source, const TileCoder& coder, TileKey key) {
  SourceTile tile;
  SampledTile sampled;
  double begin = thread_seconds();
  SLF_TRY(source.tile(key, tile));
  sampled.seconds = thread_seconds() - begin;
  if (tile.ref.state != TileState::stored) return sampled;
  const bool repeated = SLF_TRY(is_repeated(source, tile));
  if (repeated) return sampled;
  const std::vector<TileKey> references = coder.choose(key, tile.samples);
  std::vector<SourceTile> tiles(references.size());
  std::vector<ReferenceSamples> from;
  for (std::size_t k = 0; k < references.size(); ++k) {
    SLF_TRY(source.tile(references[k], tiles[k]));
    from.push_back({references[k], tiles[k].samples});
  }
  Bytes payload;
  begin = thread_seconds();
  SLF_TRY(coder.encode(key, tile.samples, from, payload));
  sampled.seconds += thread_seconds() - begin;
  sampled.bytes = payload.size();
  sampled.stored = true;
  return sampled;
}

}  // namespace

SizeEstimate& SizeEstimate::operator+=(const SizeEstimate& more) {
  bytes += more.bytes, variance += more.variance, stored += more.stored;
  seconds += more.seconds, sampled += more.sampled;
  return *this;
}

double SizeEstimate::error() const { return kDeviations * std::sqrt(variance); }

Result<SizeEstimate> sample_tiles(const TileSource& source, const TileCoder& coder,
                                  const TileOrder& order, NumberRange tiles, std::uint64_t samples,
                                  unsigned threads, Reporter& progress) {
  const std::uint64_t begin = tiles.begin, count = tiles.count();
  const std::uint64_t taken = std::min(count, samples);
  const auto encode = [&](std::uint64_t k) {
    const std::uint64_t first = begin + count * k / taken, next = begin + count * (k + 1) / taken;
    return encode_sample(source, coder, order.key(first + mix(first) % (next - first)));
  };
  SizeEstimate sum;
  double squares = 0;
  const auto add = [&](std::uint64_t, const SampledTile& tile) {
    const auto bytes = static_cast<double>(tile.bytes);
    sum += {bytes, 0, tile.stored ? 1.0 : 0.0, tile.seconds, 1}, squares += bytes * bytes;
    return progress.add(1);
  };
  SLF_TRY(make_in_order(
      taken, threads, 4 * threads, [&] { return encode; }, add));
  const auto n = static_cast<double>(taken), all = static_cast<double>(count);
  if (taken < count && taken > 1)
    sum.variance = all * all * (1 - n / all) * (squares - sum.bytes * sum.bytes / n) / (n - 1) / n;
  sum.bytes *= all / n, sum.stored *= all / n, sum.seconds *= all / n;
  return sum;
}

FileEstimate file_estimate(const FieldShape& shape, const SizeEstimate& payloads,
                           std::size_t kept) {
  std::uint64_t tiles = 0, indexed = 0;
  for (unsigned level = 0; level <= shape.finest_level; ++level) {
    tiles += shape.tiles(level);
    if (shape.tiles(level) <= kMaxIndexedTiles) indexed += shape.tiles(level);
  }
  const double error = payloads.error();
  const double bytes = payloads.bytes * (1 + kRecordShare) + kTileBytes * payloads.stored +
                       static_cast<double>(tiles) + kTreeBytes +
                       kIndexedTileBytes * static_cast<double>(indexed) + kIndexBytes +
                       static_cast<double>(kept);
  const auto whole = [](double value) { return static_cast<std::uint64_t>(std::llround(value)); };
  return {whole(bytes), whole(error + kFileUncertainty * bytes + kTreeBytes / 2)};
}

}  // namespace slf
