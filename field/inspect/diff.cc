#include <algorithm>
#include <cmath>

#include "base/parallel.h"
#include "base/try.h"
#include "field/geometry/tile_order.h"
#include "field/inspect/channel.h"
#include "slf/inspect.h"

namespace slf {
namespace {

using storage::TileRef;
using storage::TileState;

constexpr std::uint64_t kBatch = 256;        // tiles that a thread takes at a time
constexpr std::uint64_t kReleaseEvery = 64;  // batches

/// A channel of both fields.
struct Pair {
  std::string name;
  Channel a, b;
  Channel color;            ///< colour of field a
  bool same_codec = false;  ///< so equal bytes mean equal samples
};

/// The contribution of a batch of tiles to a ChannelDifference.
struct Sum {
  ChannelDifference counts;
  double squares = 0;         ///< of all differences
  std::uint64_t numbers = 0;  ///< compared
  double worst = 0;           ///< mean square of the tile that differs most

  void add(const Sum& more) {
    counts.compared += more.counts.compared;
    counts.only_in_a += more.counts.only_in_a;
    counts.only_in_b += more.counts.only_in_b;
    counts.recoded += more.counts.recoded;
    counts.differing += more.counts.differing;
    squares += more.squares;
    numbers += more.numbers;
    if (more.worst > worst) worst = more.worst, counts.worst = more.counts.worst;
  }
};

double psnr(double mean_square) {
  return mean_square > 0 ? -10 * std::log10(mean_square) : std::numeric_limits<double>::infinity();
}

/// Compares batches of tiles on one thread.
class Comparer {
 public:
  Comparer(const FieldFile& a, const FieldFile& b, const std::vector<Pair>& pairs)
      : a_(a), b_(b), pairs_(pairs), read_a_(a), read_b_(b) {}

  Result<std::vector<Sum>> compare(std::span<const TileKey> keys) {
    std::vector<Sum> sums(pairs_.size());
    std::vector<std::vector<Result<TileRef>>> in_a, in_b;
    for (const Pair& pair : pairs_) {
      in_a.push_back(a_.store().find_all(pair.a.layer, keys));
      in_b.push_back(b_.store().find_all(pair.b.layer, keys));
    }
    for (std::size_t k = 0; k < keys.size(); ++k)
      for (std::size_t c = 0; c < pairs_.size(); ++c) {
        if (!in_a[c][k]) return tl::unexpected(in_a[c][k].error());
        if (!in_b[c][k]) return tl::unexpected(in_b[c][k].error());
        SLF_TRY(compare(pairs_[c], *in_a[c][k], *in_b[c][k], sums[c]));
      }
    return sums;
  }

 private:
  Result<void> compare(const Pair& pair, const TileRef& a, const TileRef& b, Sum& sum) {
    const bool lacks_a = a.state == TileState::missing, lacks_b = b.state == TileState::missing;
    sum.counts.only_in_a += !lacks_a && lacks_b ? 1 : 0;
    sum.counts.only_in_b += lacks_a && !lacks_b ? 1 : 0;
    if (lacks_a || lacks_b) return {};
    ++sum.counts.compared;
    const codec::Tile shape = a_.tile_shape(pair.a.layer, a.key);
    const bool depth = pair.a.format == SampleFormat::depth8;
    const std::uint64_t numbers = shape.rows() * shape.columns() * (depth ? 1 : 4);
    sum.numbers += numbers;
    SLF_TRY(a_.store().fetch(a));
    SLF_TRY(b_.store().fetch(b));
    const bool same_bytes = a.state == b.state && std::equal(a.payload.begin(), a.payload.end(),
                                                             b.payload.begin(), b.payload.end());
    if (same_bytes && (pair.same_codec || a.state == TileState::empty)) return {};

    const auto samples_a = SLF_TRY(read_a_.read(pair.a, a));
    const auto samples_b = SLF_TRY(read_b_.read(pair.b, b));
    to_floats(pair.a.format, samples_a, numbers_a_);
    to_floats(pair.b.format, samples_b, numbers_b_);
    if (depth) SLF_TRY(ignore_invisible(pair, a));
    double squares = 0;
    for (std::size_t k = 0; k < numbers_a_.size(); ++k) {
      const double difference = double{numbers_a_[k]} - double{numbers_b_[k]};
      squares += difference * difference;
    }
    if (squares == 0) {
      ++sum.counts.recoded;
      return {};
    }
    ++sum.counts.differing;
    sum.squares += squares;
    const double mean = squares / static_cast<double>(numbers);
    if (mean > sum.worst) sum.worst = mean, sum.counts.worst = a.key;
    return {};
  }

  /// Depth is undefined where nothing is visible: there, sets b's depth to a's.
  Result<void> ignore_invisible(const Pair& pair, const TileRef& a) {
    const auto color = SLF_TRY(a_.store().find(pair.color.layer, a.key));
    const auto samples = SLF_TRY(read_a_.read(pair.color, color));
    to_floats(pair.color.format, samples, colors_);
    for (std::size_t k = 0; k < numbers_a_.size(); ++k)
      if (colors_[4 * k + 3] <= 0) numbers_b_[k] = numbers_a_[k];
    return {};
  }

  const FieldFile& a_;
  const FieldFile& b_;
  const std::vector<Pair>& pairs_;
  ChannelReader read_a_, read_b_;
  std::vector<float> numbers_a_, numbers_b_, colors_;
};

/// The members in which two manifests differ.
std::vector<std::string> manifest_difference(const FieldFile& a, const FieldFile& b) {
  std::vector<std::string> places;
  for (const auto& change : nlohmann::json::diff(a.manifest().to_json(), b.manifest().to_json()))
    places.push_back(change.value("path", ""));
  return places;
}

bool same_rays(const FieldShape& a, const FieldShape& b) {
  return a.sphere.center == b.sphere.center && a.sphere.radius == b.sphere.radius &&
         a.entry_side == b.entry_side && a.exit_side == b.exit_side &&
         a.entry_extra_levels == b.entry_extra_levels;
}

/// The shape with all levels and subfields of both fields.
FieldShape union_shape(const FieldShape& a, const FieldShape& b) {
  FieldShape shape = a;
  shape.levels = std::max(a.levels, b.levels);
  if (a.subfields.empty() || b.subfields.empty()) {
    shape.subfields.clear();
    return shape;
  }
  shape.subfields.clear();
  std::ranges::set_union(a.subfields, b.subfields, std::back_inserter(shape.subfields));
  return shape;
}

std::vector<Pair> channels_of_both(const FieldFile& a, const FieldFile& b) {
  std::vector<Pair> pairs;
  for (const char* name : {"color", "depth"}) {
    const auto in_a = find_channel(a, name), in_b = find_channel(b, name);
    if (!in_a || !in_b) continue;
    const codec::Codec &codec_a = a.codec(in_a->layer), &codec_b = b.codec(in_b->layer);
    const ByteSpan tables_a = codec_a.tables(), tables_b = codec_b.tables();
    const bool same = codec_a.spec() == codec_b.spec() && in_a->format == in_b->format &&
                      std::ranges::equal(tables_a, tables_b);
    pairs.push_back({name, *in_a, *in_b, *find_channel(a, "color"), same});
  }
  return pairs;
}

}  // namespace

bool FieldDifference::equal() const {
  return comparable && manifest.empty() &&
         std::ranges::all_of(channels, [](const ChannelDifference& channel) {
           return channel.only_in_a + channel.only_in_b + channel.recoded + channel.differing == 0;
         });
}

bool FieldDifference::alike(double min_psnr) const {
  return comparable && std::ranges::all_of(channels, [&](const ChannelDifference& channel) {
           return channel.only_in_a + channel.only_in_b == 0 && channel.worst_psnr >= min_psnr;
         });
}

Result<FieldDifference> diff_fields(const Field& handle_a, const Field& handle_b,
                                    const DiffOptions& options, const ProgressCallback& progress) {
  const FieldFile &a = handle_a.file(), &b = handle_b.file();
  FieldDifference difference;
  difference.manifest = manifest_difference(a, b);
  difference.comparable = same_rays(a.shape(), b.shape());
  if (!difference.comparable) return difference;

  const std::vector<Pair> pairs = channels_of_both(a, b);
  const TileOrder order(union_shape(a.shape(), b.shape()));
  const std::uint64_t batches = (order.count() + kBatch - 1) / kBatch;
  const unsigned threads = thread_count(options.threads);
  const auto keys_of = [&](std::uint64_t batch) {
    std::vector<TileKey> keys;
    for (std::uint64_t n = batch * kBatch; n < std::min((batch + 1) * kBatch, order.count()); ++n)
      keys.push_back(order.key(n));
    return keys;
  };
  OrderedPipeline<std::vector<Sum>> pipeline(batches, threads, 4 * threads, [&] {
    return [&, comparer = std::make_shared<Comparer>(a, b, pairs)](std::uint64_t batch) {
      return comparer->compare(keys_of(batch));
    };
  });
  std::vector<Sum> total(pairs.size());
  Progress state;
  state.total = order.count();
  for (std::uint64_t batch = 0; batch < batches; ++batch) {
    const std::vector<Sum> sums = SLF_TRY(pipeline.take());
    for (std::size_t c = 0; c < pairs.size(); ++c) total[c].add(sums[c]);
    if (batch % kReleaseEvery == kReleaseEvery - 1)
      a.store().release_all(), b.store().release_all();
    state.done = std::min((batch + 1) * kBatch, order.count());
    if (progress && !progress(state))
      return fail(ErrorCode::cancelled, a.path(), " and ", b.path(), ": comparison interrupted");
  }
  for (std::size_t c = 0; c < pairs.size(); ++c) {
    ChannelDifference& channel = difference.channels.emplace_back(total[c].counts);
    channel.channel = pairs[c].name;
    channel.psnr =
        psnr(total[c].squares / std::max<double>(1, static_cast<double>(total[c].numbers)));
    channel.worst_psnr = psnr(total[c].worst);
  }
  return difference;
}

}  // namespace slf
