#include "field/render/sample_gatherer.h"

#include <algorithm>
#include <span>

#include "base/sort_unique.h"
#include "base/try.h"
#include "field/render/gather_kernel.h"

namespace slf {
namespace {

constexpr std::uint64_t kPinBytes = 512;  // approximate bookkeeping of a pinned tile
constexpr std::size_t kManyKeys = 4096;   // repetitions that a list may have

/// Removes repetitions if there are many. `unique` keys were left the last time.
void remove_repetitions(std::vector<TileKey>& keys, std::size_t& unique) {
  if (keys.size() <= 2 * unique + kManyKeys) return;
  sort_unique(keys);
  unique = keys.size();
}

}  // namespace

SampleGatherer::SampleGatherer(const FieldFile& field, TileCache& cache, std::uint64_t pin_bytes)
    : cache_(cache),
      reader_(cache.epochs()),
      format_(field.format()),
      pin_bytes_(pin_bytes),
      max_tile_samples_(field.shape().max_tile_samples()) {}

void SampleGatherer::begin(std::atomic<std::uint32_t>& frame, bool with_depth) {
  frame_ = &frame;
  touched_.clear();
  misses_.clear();
  unique_touched_ = unique_misses_ = 0;
  tiles_.begin_view(cache_.state(), with_depth, touched_);
}

Result<void> SampleGatherer::gather(const LevelGeometry& geometry, bool wait, std::size_t count,
                                    const EntryCells& entries, const Pass& pass) {
  tiles_.begin_pass(*frame_, geometry, cache_.page_table(geometry.level()), wait);
  std::fill_n(tile_offsets_.unavailable.begin(), count, 0);
  gather_loaded(count, entries, pass, false);
  if (tiles_.absent().empty()) return {};
  if (wait) return gather_in_batches(count, entries, pass);
  misses_.insert(misses_.end(), tiles_.absent().begin(), tiles_.absent().end());
  remove_repetitions(misses_, unique_misses_);
  return {};
}

void SampleGatherer::gather_loaded(std::size_t count, const EntryCells& entries, const Pass& pass,
                                   bool add) {
  const TileCache::ReadScope scope(reader_);
  find_tiles(pass, entries, count, tiles_, tile_offsets_);
  gather_samples(tile_offsets_, pass, entries, count, half_floats(), add, samples_);
}

Result<void> SampleGatherer::gather_in_batches(std::size_t count, const EntryCells& entries,
                                               const Pass& pass) {
  std::vector<TileKey> keys = tiles_.absent();
  sort_unique(keys);
  touched_.insert(touched_.end(), keys.begin(), keys.end());
  const std::size_t max_batch = std::max<std::uint64_t>(
      pin_bytes_ / (max_tile_samples_ * sample_bytes(format_) + kPinBytes), 1);
  for (std::size_t begin = 0; begin < keys.size(); begin += max_batch) {
    const auto batch = std::span(keys).subspan(begin, std::min(max_batch, keys.size() - begin));
    const auto pins = SLF_TRY(cache_.load(batch));
    gather_loaded(count, entries, pass, true);  // reads tiles that stayed loaded again
  }
  *frame_ = cache_.resume_frame(*frame_);
  remove_repetitions(touched_, unique_touched_);
  return {};
}

}  // namespace slf
