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

struct TileCache::Entry : Link {
  Id id;
  storage::TileRef tile;
  const std::byte* samples = nullptr;
  std::unique_ptr<std::byte[]> owned;  // what `samples` points to, unless it is the map
  std::uint64_t cost = 0;              // what it counts for in the budget
  std::uint64_t used = 0;              // when it was last unpinned
  std::uint32_t pins = 0;              // 0: linked into idle_
  bool ready = false;
  bool in_place = false;  // samples are in the map
  std::optional<Error> error;
};

TileCache::TileCache(const Field& field, std::uint64_t budget, std::uint64_t map_budget,
                     bool in_place)
    : field_(field), budget_(budget), map_budget_(map_budget), in_place_(in_place) {}
TileCache::~TileCache() = default;

TileCache::Pin& TileCache::Pin::operator=(Pin&& other) noexcept {
  if (this != &other) {
    release();
    cache_ = other.cache_;
    entry_ = std::exchange(other.entry_, nullptr);
  }
  return *this;
}

void TileCache::Pin::release() {
  if (entry_) cache_->unpin(*std::exchange(entry_, nullptr));
}

storage::TileState TileCache::Pin::state() const { return entry_->tile.state; }
const std::byte* TileCache::Pin::samples() const { return entry_->samples; }
const storage::TileRef& TileCache::Pin::tile() const { return entry_->tile; }

Result<TileCache::Pin> TileCache::get(storage::LayerId layer, TileKey key) {
  const Id id{layer, key};
  std::unique_lock lock(mutex_);
  std::unique_ptr<Entry>& place = entries_[id];
  if (place) {
    Entry& entry = *place;
    pin_locked(entry);
    loaded_.wait(lock, [&] { return entry.ready; });
    if (!entry.error) {
      ++statistics_.hits;
      return Pin(this, &entry);
    }
    Error error = *entry.error;
    unpin_locked(entry);
    return tl::unexpected(std::move(error));
  }

  place = std::make_unique<Entry>();
  Entry& entry = *place;
  entry.id = id;
  entry.pins = 1;
  lock.unlock();
  auto ok = load(entry, id);
  lock.lock();
  entry.ready = true;
  loaded_.notify_all();
  if (ok) return Pin(this, &entry);
  entry.error = ok.error();  // for those who wait too; it goes with the last of them
  unpin_locked(entry);
  return tl::unexpected(ok.error());
}

std::vector<TileCache::Pin> TileCache::find(storage::LayerId layer, std::span<const TileKey> keys) {
  std::vector<Pin> pins(keys.size());
  const std::lock_guard lock(mutex_);
  for (std::size_t k = 0; k < keys.size(); ++k) {
    const auto found = entries_.find({layer, keys[k]});
    if (found == entries_.end()) continue;
    Entry& entry = *found->second;
    if (!entry.ready || entry.error) continue;
    pin_locked(entry);
    ++statistics_.hits;
    pins[k] = Pin(this, &entry);
  }
  return pins;
}

void TileCache::release(std::span<Pin> pins) {
  const std::lock_guard lock(mutex_);
  for (Pin& pin : pins)
    if (pin.entry_) unpin_locked(*std::exchange(pin.entry_, nullptr));
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
  entry.owned = std::make_unique_for_overwrite<std::byte[]>(bytes + kLoad);
  entry.samples = entry.owned.get();
  return field_.decode(*tile, {entry.owned.get(), bytes});
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
  entry.before->after = entry.after;
  entry.after->before = entry.before;
  if (entry.in_place) map_locked(entry.tile);
}

void TileCache::map_locked(const storage::TileRef& tile) {
  const auto [begin, end] = field_.store().range(tile);
  // Neighbours are mostly read together; others take their record's table and a leaf of the tree,
  // and so do tiles that are empty.
  std::uint64_t windows = 2;
  if (begin < end) {
    const std::uint64_t first = begin / kMapWindow, last = (end - 1) / kMapWindow;
    windows = last - first + (first == mapped_window_ ? 0 : 3);
    mapped_window_ = last;
  }
  mapped_bytes_ += windows * kMapWindow;
  if (mapped_bytes_ <= map_budget_) return;
  field_.store().release_all();
  mapped_bytes_ = kTreeWindows * kMapWindow;  // these are soon back
  mapped_window_ = kUnlimited;
}

void TileCache::unpin(Entry& entry) {
  const std::lock_guard lock(mutex_);
  unpin_locked(entry);
}

void TileCache::unpin_locked(Entry& entry) {
  if (--entry.pins > 0) return;
  if (entry.error) {
    statistics_.decoded_bytes -= entry.cost;
    entries_.erase(Id(entry.id));
    return;
  }
  entry.used = ++clock_;
  entry.after = &idle_;
  entry.before = idle_.before;
  entry.before->after = entry.after->before = &entry;
  if (statistics_.decoded_bytes > budget_) evict_locked(budget_);
}

void TileCache::evict_locked(std::uint64_t budget) {
  while (statistics_.decoded_bytes > budget && idle_.after != &idle_) {
    auto& entry = static_cast<Entry&>(*idle_.after);
    entry.after->before = &idle_;
    idle_.after = entry.after;
    statistics_.decoded_bytes -= entry.cost;
    entries_.erase(Id(entry.id));
  }
}

std::uint64_t TileCache::now() const {
  const std::lock_guard lock(mutex_);
  return clock_;
}

bool TileCache::has_room(std::uint64_t since) const {
  const std::lock_guard lock(mutex_);
  if (statistics_.decoded_bytes < budget_ - budget_ / 8) return true;
  return idle_.after != &idle_ && static_cast<const Entry&>(*idle_.after).used <= since;
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
