#include "field/tile_cache.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace slf {

namespace {
constexpr std::uint64_t kEntryBytes = 256;     // bookkeeping of one entry, about
constexpr std::uint64_t kMapWindow = 1 << 16;  // what Linux maps around a page that is read
constexpr std::uint64_t kTreeWindows = 3;      // on the way through the search tree, about
// The renderer loads so many bytes at a time, from within a row of samples where it has as many:
// behind shorter ones there must be room.
constexpr std::size_t kLoad = 8;
}  // namespace

struct TileCache::Entry {
  Id id;
  storage::TileRef tile;
  const std::byte* samples = nullptr;
  std::vector<std::byte> owned;  // what `samples` points to, unless it is the map
  std::uint64_t cost = 0;        // what it counts for in the budget
  std::uint32_t pins = 0;
  std::uint64_t used = 0;  // when it was last unpinned
  bool ready = false;
  bool in_place = false;  // samples are in the map
  std::optional<Error> error;
  std::list<Id>::iterator place;  // in unpinned_, valid while pins == 0
};

TileCache::Pin& TileCache::Pin::operator=(Pin&& other) noexcept {
  if (this != &other) {
    release();
    cache_ = std::exchange(other.cache_, nullptr);
    entry_ = std::move(other.entry_);
  }
  return *this;
}

void TileCache::Pin::release() {
  if (cache_ && entry_) cache_->unpin(entry_);
  cache_ = nullptr;
  entry_.reset();
}

storage::TileState TileCache::Pin::state() const { return entry_->tile.state; }
const std::byte* TileCache::Pin::samples() const { return entry_->samples; }
const storage::TileRef& TileCache::Pin::tile() const { return entry_->tile; }

Result<TileCache::Pin> TileCache::get(storage::LayerId layer, TileKey key) {
  const Id id{layer, key};
  std::unique_lock lock(mutex_);
  if (const auto found = entries_.find(id); found != entries_.end()) {
    const std::shared_ptr<Entry> entry = found->second;
    pin_locked(*entry);
    loaded_.wait(lock, [&] { return entry->ready; });
    if (entry->error) return tl::unexpected(*entry->error);
    ++statistics_.hits;
    return Pin(this, entry);
  }

  const auto entry = std::make_shared<Entry>();
  entry->id = id;
  entry->pins = 1;
  entries_.emplace(id, entry);
  lock.unlock();
  auto ok = load(*entry, id);
  lock.lock();
  entry->ready = true;
  if (!ok) {  // those who waited get the error too; the next to ask tries again
    entry->error = ok.error();
    entries_.erase(id);
    statistics_.decoded_bytes -= entry->cost;
    loaded_.notify_all();
    return tl::unexpected(ok.error());
  }
  loaded_.notify_all();
  return Pin(this, entry);
}

TileCache::Pin TileCache::find(storage::LayerId layer, TileKey key) {
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find({layer, key});
  if (found == entries_.end() || !found->second->ready) return {};
  const std::shared_ptr<Entry>& entry = found->second;
  pin_locked(*entry);
  ++statistics_.hits;
  return Pin(this, entry);
}

void TileCache::charge(Entry& entry, std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  entry.cost = bytes + kEntryBytes;
  evict_locked(budget_ > entry.cost ? budget_ - entry.cost : 0);
  statistics_.decodes += bytes > 0;
  statistics_.loaded_bytes += entry.tile.payload.size();
  map_locked(entry.tile);
  statistics_.decoded_bytes += entry.cost;
  statistics_.decoded_peak_bytes =
      std::max(statistics_.decoded_peak_bytes, statistics_.decoded_bytes);
}

Result<void> TileCache::load(Entry& entry, const Id& id) {
  const auto tile = field_.store().find(id.layer, id.key);
  if (!tile) return tl::unexpected(tile.error());
  entry.tile = *tile;
  const bool stored = tile->state == storage::TileState::stored;
  const std::size_t bytes = stored ? field_.tile_shape(id.layer, id.key).bytes() : 0;
  const bool in_place = in_place_ && stored && field_.codec(id.layer).in_place() &&
                        tile->payload.size() == bytes &&
                        triangle_size(field_.shape().exit_side) >= kLoad;
  entry.in_place = in_place;
  charge(entry, in_place ? 0 : bytes);
  if (in_place) {
    entry.samples = tile->payload.data();
    return field_.store().check(*tile);
  }
  if (!stored) return {};
  entry.owned.resize(bytes + kLoad);
  entry.samples = entry.owned.data();
  return field_.decode(*tile, std::span(entry.owned).first(bytes));
}

void TileCache::advise(storage::LayerId layer, std::span<const TileKey> keys) {
  std::vector<TileKey> wanted;
  {
    const std::lock_guard lock(mutex_);
    for (const TileKey& key : keys)
      if (!entries_.contains({layer, key})) wanted.push_back(key);
  }
  // All together, unless the tables of so many records were too much of the map.
  const std::size_t most = std::max<std::uint64_t>(map_budget_ / (4 * kMapWindow), 1);
  for (std::span<const TileKey> rest = wanted; !rest.empty();) {
    const auto some = rest.first(std::min(most, rest.size()));
    rest = rest.subspan(some.size());
    std::vector<storage::TileRef> tiles;
    for (const auto& found : field_.store().find_all(layer, some))
      if (found && found->state == storage::TileState::stored) tiles.push_back(*found);
    field_.store().advise(tiles);
    const std::lock_guard lock(mutex_);
    for (const storage::TileRef& tile : tiles) map_locked(tile);
  }
}

void TileCache::pin_locked(Entry& entry) {
  if (entry.pins++ > 0) return;
  unpinned_.erase(entry.place);
  if (entry.in_place) map_locked(entry.tile);
}

void TileCache::map_locked(const storage::TileRef& tile) {
  const auto [begin, end] = field_.store().range(tile);
  if (begin == end) return;
  const std::uint64_t first = begin / kMapWindow, last = (end - 1) / kMapWindow;
  // One more for the table of its record; neighbours are mostly read together.
  const bool counted = first == mapped_window_;
  mapped_bytes_ += (last - first + (counted ? 0 : 2)) * kMapWindow;
  mapped_window_ = last;
  if (mapped_bytes_ <= map_budget_) return;
  field_.store().release_all();
  mapped_bytes_ = kTreeWindows * kMapWindow;  // these are soon back
}

void TileCache::unpin(const std::shared_ptr<Entry>& entry) {
  const std::lock_guard lock(mutex_);
  if (--entry->pins > 0) return;
  entry->used = ++clock_;
  entry->place = unpinned_.insert(unpinned_.end(), entry->id);
  if (statistics_.decoded_bytes > budget_) evict_locked(budget_);
}

void TileCache::evict_locked(std::uint64_t budget) {
  while (statistics_.decoded_bytes > budget && !unpinned_.empty()) {
    const auto found = entries_.find(unpinned_.front());
    unpinned_.pop_front();
    statistics_.decoded_bytes -= found->second->cost;
    entries_.erase(found);
  }
}

std::uint64_t TileCache::now() const {
  const std::lock_guard lock(mutex_);
  return clock_;
}

bool TileCache::has_room(std::uint64_t since) const {
  const std::lock_guard lock(mutex_);
  if (statistics_.decoded_bytes < budget_ - budget_ / 8) return true;
  return !unpinned_.empty() && entries_.at(unpinned_.front())->used <= since;
}

CacheStatistics TileCache::statistics() const {
  const std::lock_guard lock(mutex_);
  return statistics_;
}

void TileCache::reset_peak() {
  const std::lock_guard lock(mutex_);
  statistics_.decoded_peak_bytes = statistics_.decoded_bytes;
}

}  // namespace slf
