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
/// One sampled tile of so many is also predicted, which takes a dozen others. What that saves of
/// their bytes, it saves of all.
constexpr std::uint64_t kPredictedShare = 4;

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
  std::uint64_t alone = 0;      ///< bytes, if it is not predicted
  std::uint64_t predicted = 0;  ///< bytes, if it is
  bool stored = false;
  double seconds = 0;   ///< to read or trace it
  double encoding = 0;  ///< seconds to encode it, of one that is predicted where that is possible
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

/// `predicts`: whether to predict it, too, from tiles of `coarser`.
Result<SampledTile> encode_sample(const TileSource& source, const TileSource& coarser,
                                  const TileCoder& coder, TileKey key, bool predicts) {
  SourceTile tile;
  SampledTile sampled;
  double begin = thread_seconds();
  SLF_TRY(source.tile(key, tile));
  sampled.seconds = thread_seconds() - begin;
  if (tile.ref.state != TileState::stored) return sampled;
  const bool repeated = SLF_TRY(is_repeated(source, tile));
  if (repeated) return sampled;
  Bytes payload;
  begin = thread_seconds();
  SLF_TRY(coder.encode(key, tile.samples, {}, payload));
  sampled.encoding = thread_seconds() - begin;
  sampled.alone = sampled.predicted = payload.size();
  sampled.stored = true;
  if (!predicts) return sampled;
  begin = thread_seconds();
  const std::vector<TileKey> references = coder.choose(key, tile.samples);
  if (references.empty()) return sampled;
  sampled.encoding = thread_seconds() - begin;
  std::vector<SourceTile> tiles(references.size());
  std::vector<ReferenceSamples> from;
  for (std::size_t k = 0; k < references.size(); ++k) {
    SLF_TRY(coarser.tile(references[k], tiles[k]));
    from.push_back({references[k], tiles[k].samples});
  }
  begin = thread_seconds();
  SLF_TRY(coder.encode(key, tile.samples, from, payload));
  sampled.encoding += thread_seconds() - begin;
  sampled.predicted = payload.size();
  return sampled;
}

}  // namespace

SizeEstimate& SizeEstimate::operator+=(const SizeEstimate& more) {
  bytes += more.bytes, variance += more.variance, stored += more.stored;
  seconds += more.seconds, sampled += more.sampled;
  return *this;
}

double SizeEstimate::error() const { return kDeviations * std::sqrt(variance); }

Result<SizeEstimate> sample_tiles(const TileSource& source, const TileSource& coarser,
                                  const TileCoder& coder, const TileOrder& order, NumberRange tiles,
                                  std::uint64_t samples, unsigned threads, Reporter& progress) {
  const std::uint64_t begin = tiles.begin, count = tiles.count();
  const std::uint64_t taken = std::min(count, samples);
  const std::uint64_t share = taken == count ? 1 : kPredictedShare;
  const auto encode = [&](std::uint64_t k) {
    const std::uint64_t first = begin + count * k / taken, next = begin + count * (k + 1) / taken;
    return encode_sample(source, coarser, coder, order.key(first + mix(first) % (next - first)),
                         k % share == 0);
  };
  // Two-phase sampling (Cochran, Sampling Techniques, 12.5): bytes alone of all that are sampled,
  // times the ratio of those that are predicted, too.
  SizeEstimate sum;
  double squares = 0;
  struct {
    double n = 0, alone = 0, bytes = 0, alone2 = 0, bytes2 = 0, product = 0, seconds = 0;
  } both;
  const auto add = [&](std::uint64_t k, const SampledTile& tile) {
    const auto alone = static_cast<double>(tile.alone), bytes = static_cast<double>(tile.predicted);
    sum += {alone, 0, tile.stored ? 1.0 : 0.0, tile.seconds, 1}, squares += alone * alone;
    if (k % share == 0) {
      both.n += 1, both.alone += alone, both.bytes += bytes;
      both.alone2 += alone * alone, both.bytes2 += bytes * bytes, both.product += alone * bytes;
      both.seconds += tile.encoding;
    }
    return progress.add(1);
  };
  SLF_TRY(make_in_order(
      taken, threads, 4 * threads, [&] { return encode; }, add));
  const auto n = static_cast<double>(taken), all = static_cast<double>(count);
  const double ratio = both.alone > 0 ? both.bytes / both.alone : 1;
  if (taken < count && taken > 1) {
    const double of_tiles = ratio * ratio * (squares - sum.bytes * sum.bytes / n) / (n - 1);
    const double of_ratio = (both.bytes2 - 2 * ratio * both.product + ratio * ratio * both.alone2) /
                            std::max(1.0, both.n - 1);
    sum.variance = all * all * ((1 / n - 1 / all) * of_tiles + (1 / both.n - 1 / n) * of_ratio);
  }
  sum.bytes *= ratio * all / n, sum.stored *= all / n, sum.seconds *= all / n;
  sum.seconds += both.seconds * all / both.n;
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
