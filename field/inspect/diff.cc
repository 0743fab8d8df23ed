#include <algorithm>
#include <cmath>

#include "base/parallel.h"
#include "base/reporter.h"
#include "base/try.h"
#include "field/geometry/tile_order.h"
#include "field/inspect/channel.h"
#include "field/tiles/tile_cache.h"
#include "slf/inspect.h"

namespace slf {
namespace {

using storage::TileRef;
using storage::TileState;

constexpr std::uint64_t kBatch = 256;           // tiles that a thread takes at a time
constexpr std::uint64_t kReleaseBatches = 64;   // batches
constexpr std::uint64_t kMemory = 32ull << 20;  // for decoded tiles of each field

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

/// Whether equal bytes mean equal samples.
bool have_same_codec(const FieldFile& a, const FieldFile& b) {
  return a.codec().spec() == b.codec().spec() && a.format() == b.format() &&
         std::ranges::equal(a.codec().tables(), b.codec().tables());
}

/// The part of a tile's samples that holds a channel.
ByteSpan channel_of(const TileShape& shape, ByteSpan samples, bool depth) {
  return depth ? samples.subspan(shape.color_bytes()) : samples.first(shape.color_bytes());
}

/// Compares batches of tiles on one thread.
class Comparer {
 public:
  /// `channels`: 1: colour, which both have; 2: depth, too. `all_states`: keys name their state.
  /// `composed`: a field is. `by_bytes`: whether a tile that has the same bytes in both fields has
  /// the same samples, or is predicted from one that has not.
  Comparer(TileCache& tiles_a, TileCache& tiles_b, std::size_t channels, bool all_states,
           bool composed, bool by_bytes)
      : a_(tiles_a.field()),
        b_(tiles_b.field()),
        tiles_a_(tiles_a),
        tiles_b_(tiles_b),
        channels_(channels),
        all_states_(all_states),
        composed_(composed),
        by_bytes_(by_bytes) {}

  /// The sum of each channel.
  Result<std::vector<Sum>> compare(std::span<const TileKey> keys) {
    std::vector<Sum> sums(channels_);
    const auto find = [&](const TileCache& tiles) {
      const auto& store = tiles.field().store();
      return store.find_all(all_states_ ? std::vector(keys.begin(), keys.end())
                                        : in_state(keys, tiles.state()));
    };
    const auto in_a = find(tiles_a_), in_b = find(tiles_b_);
    for (std::size_t k = 0; k < keys.size(); ++k) {
      if (!in_a[k]) return tl::unexpected(in_a[k].error());
      if (!in_b[k]) return tl::unexpected(in_b[k].error());
      SLF_TRY(compare(*in_a[k], *in_b[k], sums));
    }
    return sums;
  }

 private:
  Result<void> compare(TileRef a, TileRef b, std::vector<Sum>& sums) {
    if (composed_) {  // no file has what is compared
      const auto pin_a = SLF_TRY(tiles_a_.load(a.key));
      const auto pin_b = SLF_TRY(tiles_b_.load(b.key));
      a = {pin_a.state(), a.key}, b = {pin_b.state(), b.key};
    }
    const bool lacks_a = a.state == TileState::missing, lacks_b = b.state == TileState::missing;
    for (Sum& sum : sums) {
      sum.counts.only_in_a += !lacks_a && lacks_b ? 1 : 0;
      sum.counts.only_in_b += lacks_a && !lacks_b ? 1 : 0;
    }
    if (lacks_a || lacks_b) return {};
    const TileShape shape = a_.tile_shape(a.key);
    for (std::size_t c = 0; c < sums.size(); ++c) {
      ++sums[c].counts.compared;
      sums[c].numbers += shape.samples() * (c == 0 ? 4 : 1);
    }
    SLF_TRY(a_.store().fetch(a));
    SLF_TRY(b_.store().fetch(b));
    const bool same_bytes = a.state == b.state && std::ranges::equal(a.payload, b.payload);
    const bool same_source = a.source == b.source || !a_.predicts();
    if (same_bytes && ((by_bytes_ && same_source) || a.state == TileState::empty)) return {};

    SLF_TRY(tiles_a_.read(a.key, samples_a_));
    SLF_TRY(tiles_b_.read(b.key, samples_b_));
    for (std::size_t c = 0; c < sums.size(); ++c)
      compare_channel(c == 1, all_states_ ? a.key : in_state(a.key, 0), same_bytes, sums[c]);
    return {};
  }

  void compare_channel(bool depth, TileKey key, bool same_bytes, Sum& sum) {
    const TileShape shape_a = a_.tile_shape(key), shape_b = b_.tile_shape(key);
    // Depth is undefined where nothing is visible.
    if (depth) to_floats(is_half(a_.format()), channel_of(shape_a, samples_a_, false), colors_);
    to_floats(!depth && is_half(a_.format()), channel_of(shape_a, samples_a_, depth), numbers_a_);
    to_floats(!depth && is_half(b_.format()), channel_of(shape_b, samples_b_, depth), numbers_b_);
    double squares = 0;
    for (std::size_t k = 0; k < numbers_a_.size(); ++k) {
      if (depth && colors_[4 * k + 3] <= 0) continue;
      const double x = numbers_a_[k], y = numbers_b_[k];
      if (x == y || (std::isnan(x) && std::isnan(y))) continue;
      // What is no number differs from any number without bound.
      squares += std::isfinite(x - y) ? (x - y) * (x - y) : std::numeric_limits<double>::infinity();
    }
    if (squares > 0)
      ++sum.counts.differing;
    else if (!same_bytes)
      ++sum.counts.recoded;
    sum.squares += squares;
    const double mean = squares / static_cast<double>(numbers_a_.size());
    if (mean > sum.worst) sum.worst = mean, sum.counts.worst = key;
  }

  const FieldFile& a_;
  const FieldFile& b_;
  TileCache& tiles_a_;
  TileCache& tiles_b_;
  const std::size_t channels_;
  const bool all_states_;
  const bool composed_;
  const bool by_bytes_;
  Bytes samples_a_, samples_b_;
  std::vector<float> numbers_a_, numbers_b_, colors_;
};

/// The members in which two manifests differ.
std::vector<std::string> manifest_difference(const FieldFile& a, const FieldFile& b) {
  std::vector<std::string> places;
  for (const auto& change : nlohmann::json::diff(*a.manifest().to_json(), *b.manifest().to_json()))
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
  shape.finest_level = std::max(a.finest_level, b.finest_level);
  shape.states = std::max(a.states, b.states);
  shape.subfields.clear();
  if (!a.subfields.empty() && !b.subfields.empty())
    std::ranges::set_union(a.subfields, b.subfields, std::back_inserter(shape.subfields));
  return shape;
}

/// What is in either.
TileSelection united(const TileSelection& a, const TileSelection& b) {
  std::vector<NumberRange> ranges;
  std::ranges::merge(a.ranges(), b.ranges(), std::back_inserter(ranges), {}, &NumberRange::begin,
                     &NumberRange::begin);
  TileSelection all;
  std::uint64_t end = 0;
  for (const NumberRange& range : ranges) {
    all.add({std::max(range.begin, std::min(end, range.end)), range.end});
    end = std::max(end, range.end);
  }
  return all;
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
                                    const DiffOptions& options,
                                    const ProgressCallback& progress) try {
  const bool composed = handle_a.structures() || handle_b.structures();
  const bool all_states = options.all_states && !composed;
  const FieldFile &a = handle_a.file(), &b = handle_b.file();
  FieldDifference difference;
  difference.manifest = manifest_difference(a, b);
  difference.comparable = same_rays(a.shape(), b.shape());
  if (!difference.comparable) return difference;

  TileCache tiles_a(a, kMemory, handle_a.state(), handle_a.structures()),
      tiles_b(b, kMemory, handle_b.state(), handle_b.structures());
  // One state alone may be predicted from others, which are not compared.
  const bool by_bytes = have_same_codec(a, b) && !composed &&
                        (options.all_states || !a.predicts() ||
                         (a.manifest().states.empty() && b.manifest().states.empty()));
  const std::size_t channels = a.has_depth() && b.has_depth() ? 2 : 1;
  const TileOrder order(all_states ? union_shape(a.shape(), b.shape())
                                   : union_shape(handle_a.shape(), handle_b.shape()));
  TileSelection all;
  std::vector<Field> fields{handle_a, handle_b};
  for (const Field* handle : {&handle_a, &handle_b})
    if (handle->structures()) std::ranges::copy(sources_of(*handle), std::back_inserter(fields));
  for (const Field& field : fields) {
    const auto recorded = SLF_TRY(
        field.file().recorded(order, all_states ? std::nullopt : std::optional(field.state())));
    all = united(all, recorded);
  }
  const std::uint64_t batches = (all.count() + kBatch - 1) / kBatch;
  const unsigned threads = thread_count(options.threads);
  const auto keys_of = [&](std::uint64_t batch) {
    std::vector<TileKey> keys;
    for (std::uint64_t k = batch * kBatch; k < std::min((batch + 1) * kBatch, all.count()); ++k)
      keys.push_back(order.key(all.number(k)));
    return keys;
  };
  const auto new_maker = [&] {
    return [&, comparer = Comparer(tiles_a, tiles_b, channels, all_states, composed, by_bytes)](
               std::uint64_t batch) mutable { return comparer.compare(keys_of(batch)); };
  };
  std::vector<Sum> total(channels);
  Reporter reporter(progress, {0, all.count(), 0},
                    a.path() + " and " + b.path() + ": comparison interrupted");
  const auto add = [&](std::uint64_t batch, const std::vector<Sum>& sums) {
    for (std::size_t c = 0; c < total.size(); ++c) total[c].add(sums[c]);
    if (batch % kReleaseBatches == kReleaseBatches - 1)
      a.store().release_all(), b.store().release_all();
    return reporter.add(std::min<std::uint64_t>(kBatch, all.count() - batch * kBatch));
  };
  SLF_TRY(make_in_order(batches, threads, 4 * threads, new_maker, add));
  for (std::size_t c = 0; c < total.size(); ++c) {
    ChannelDifference& channel = difference.channels.emplace_back(total[c].counts);
    channel.channel = c == 0 ? "color" : "depth";
    channel.psnr =
        psnr(total[c].squares / std::max<double>(1, static_cast<double>(total[c].numbers)));
    channel.worst_psnr = psnr(total[c].worst);
    if (!channel.worst) continue;
    const unsigned state = channel.worst->state;
    channel.worst_at = address_of(handle_a, *channel.worst);
    channel.worst_name = to_string(*channel.worst_at);
    if (state > 0) channel.worst_name->append(" of state ").append(handle_a.states()[state]);
  }
  return difference;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
