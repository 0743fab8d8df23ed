#include "field/render/tile_cache.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "base/guarded.h"

namespace slf {

namespace {
constexpr std::uint64_t kEntryBytes = 512;     // bookkeeping of one entry, about
constexpr std::uint64_t kMapWindow = 1 << 16;  // what Linux maps around a page that is read
constexpr std::uint64_t kTreeWindows = 3;      // on the way through the search tree, about
}  // namespace

/// What an entry has of one layer.
struct TileCache::Part {
  enum class Stage : std::uint8_t { absent, loading, ready };

  storage::TileRef tile;
  const std::byte* samples = nullptr;
  std::unique_ptr<std::byte[]> owned;  // what `samples` points to, unless it is the map
  std::optional<Error> error;
  Stage stage = Stage::absent;
  bool in_place = false;  // samples are in the map
  bool mapped = false;    // the payload is read there

  [[nodiscard]] bool good() const { return stage == Stage::ready && !error; }
};

struct TileCache::Entry : Link {
  TileKey key;
  Part color, depth;
  std::uint64_t cost = 0;  // what it counts for in the budget
  std::uint64_t used = 0;  // when it was last unpinned
  std::uint32_t pins = 0;  // 0: linked into idle_

  /// REQUIRES: the colour is here.
  [[nodiscard]] bool visible() const { return color.tile.state == storage::TileState::stored; }
  [[nodiscard]] bool lacks_depth() const {
    return color.good() && visible() && depth.stage == Part::Stage::absent;
  }
};

TileCache::TileCache(const FieldFile& field, std::uint64_t budget, std::uint64_t map_budget,
                     bool in_place)
    : field_(field),
      color_(field.layer("color").value()),
      depth_(field.layer("depth")),
      budget_(budget),
      map_budget_(map_budget),
      in_place_(in_place) {}
TileCache::~TileCache() = default;

/// Has the cache to itself, and once it has let go does what nobody needs to wait for.
class TileCache::Hold {
 public:
  explicit Hold(TileCache& cache) : cache_(cache), lock_(cache.mutex_) {}
  ~Hold() {
    const auto dropped = std::exchange(cache_.dropped_, {});
    const bool release = std::exchange(cache_.release_due_, false);
    lock_.unlock();
    if (release) cache_.field_.store().release_all();
  }

  [[nodiscard]] std::unique_lock<std::mutex>& lock() { return lock_; }

 private:
  TileCache& cache_;
  std::unique_lock<std::mutex> lock_;
};

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

bool TileCache::Pin::missing(bool with_depth) const {
  const auto never_built = [](const Part& part) {
    return part.good() && part.tile.state == storage::TileState::missing;
  };
  return never_built(entry_->color) || (with_depth && never_built(entry_->depth));
}
const std::byte* TileCache::Pin::color() const { return entry_->color.samples; }
const std::byte* TileCache::Pin::depth() const { return entry_->depth.samples; }

Result<TileCache::Pin> TileCache::get(const Located& tile, bool with_depth) {
  Hold hold(*this);
  const auto [place, added] = entries_.try_emplace(tile.key);
  Entry& entry = place->second;
  if (added) entry.key = tile.key;
  pin_locked(entry);
  auto here = bring(hold.lock(), entry, entry.color, color_, tile.color);
  if (const auto depth = depth_of(with_depth); here && depth && entry.visible())
    here = bring(hold.lock(), entry, entry.depth, *depth, tile.depth);
  if (here) return Pin(this, &entry);
  unpin_locked(entry);
  return tl::unexpected(std::move(here.error()));
}

Result<void> TileCache::bring(std::unique_lock<std::mutex>& lock, Entry& entry, Part& part,
                              storage::LayerId layer,
                              const std::optional<storage::TileRef>& located) {
  if (part.stage == Part::Stage::absent) {
    part.stage = Part::Stage::loading;
    lock.unlock();
    auto ok = guarded([&] { return load(entry, part, layer, located); });  // others wait for it
    lock.lock();
    part.stage = Part::Stage::ready;
    if (!ok) part.error = std::move(ok.error());  // it goes with the last who pin the entry
    loaded_.notify_all();
  } else {
    loaded_.wait(lock, [&] { return part.stage == Part::Stage::ready; });
  }
  if (part.error) return tl::unexpected(*part.error);
  return {};
}

std::vector<TileCache::Pin> TileCache::find(std::span<const TileKey> keys, bool with_depth) {
  std::vector<Pin> pins(keys.size());
  const bool depth = depth_of(with_depth).has_value();
  const Hold hold(*this);
  for (std::size_t k = 0; k < keys.size(); ++k) {
    const auto found = entries_.find(keys[k]);
    if (found == entries_.end()) continue;
    Entry& entry = found->second;
    if (!entry.color.good() || (depth && entry.visible() && !entry.depth.good())) continue;
    pin_locked(entry);
    pins[k] = Pin(this, &entry);
  }
  return pins;
}

void TileCache::release(std::span<Pin> pins) {
  const Hold hold(*this);
  for (Pin& pin : pins)
    if (pin.entry_) unpin_locked(*std::exchange(pin.entry_, nullptr));
}

void TileCache::charge(Entry& entry, const Part& part, std::uint64_t bytes, bool located) {
  const Hold hold(*this);
  const std::uint64_t cost = bytes + (entry.cost == 0 ? kEntryBytes : 0);
  evict_locked(budget_ > cost ? budget_ - cost : 0);
  entry.cost += cost;
  statistics_.decodes += bytes > 0;
  statistics_.loaded_bytes += part.tile.payload.size();
  if (part.mapped || !located) map_locked(part.tile, part.mapped);
  statistics_.decoded_bytes += cost;
  statistics_.decoded_peak_bytes =
      std::max(statistics_.decoded_peak_bytes, statistics_.decoded_bytes);
}

Result<void> TileCache::load(Entry& entry, Part& part, storage::LayerId layer,
                             const std::optional<storage::TileRef>& located) {
  const auto tile = located ? *located : field_.store().find(layer, entry.key);
  if (!tile) return tl::unexpected(tile.error());
  part.tile = *tile;
  const bool stored = tile->state == storage::TileState::stored;
  const std::size_t bytes = stored ? field_.tile_shape(layer, entry.key).bytes() : 0;
  const bool raw = stored && field_.codec(layer).in_place() && tile->payload.size() == bytes;
  part.in_place = in_place_ && raw;
  part.mapped = stored && (part.in_place || !raw);
  charge(entry, part, part.in_place ? 0 : bytes, located.has_value());
  if (part.in_place) {
    part.samples = tile->payload.data();  // a record's table comes before any payload
    return field_.store().check(*tile);
  }
  if (!stored) return {};
  part.owned = std::make_unique_for_overwrite<std::byte[]>(kBefore + bytes);
  std::byte* samples = part.owned.get() + kBefore;
  part.samples = samples;
  return field_.decode(*tile, {samples, bytes});
}

std::vector<TileCache::Located> TileCache::locate(std::span<const TileKey> keys, bool with_depth) {
  const auto depth = depth_of(with_depth);
  std::vector<Located> located(keys.size());
  std::vector<TileKey> wanted;
  std::vector<std::size_t> places;  // of the wanted ones among all
  {
    const std::lock_guard lock(mutex_);
    for (std::size_t k = 0; k < keys.size(); ++k) {
      located[k].key = keys[k];
      const auto found = entries_.find(keys[k]);
      if (found != entries_.end() && !(depth && found->second.lacks_depth())) continue;
      wanted.push_back(keys[k]);
      places.push_back(k);
    }
  }
  // All together, unless the tables of so many records were too much of the map.
  const std::size_t most =
      std::max<std::uint64_t>(map_budget_ / (4 * kMapWindow * (depth ? 2 : 1)), 1);
  for (std::size_t begin = 0; begin < wanted.size(); begin += most) {
    const auto some = std::span(wanted).subspan(begin, std::min(most, wanted.size() - begin));
    std::vector<storage::TileRef> tiles;
    const auto look_up = [&](storage::LayerId layer, auto part) {
      const auto found = field_.store().find_all(layer, some);
      for (std::size_t k = 0; k < found.size(); ++k) {
        if (!found[k]) continue;  // get() says why
        located[places[begin + k]].*part = *found[k];
        tiles.push_back(*found[k]);
      }
    };
    look_up(color_, &Located::color);
    if (depth) look_up(*depth, &Located::depth);
    field_.store().advise(tiles);
    const Hold hold(*this);
    for (const storage::TileRef& tile : tiles) map_locked(tile, false);
  }
  return located;
}

void TileCache::pin_locked(Entry& entry) {
  if (entry.pins++ > 0) return;
  entry.before->after = entry.after;
  entry.after->before = entry.before;
  for (const Part* part : {&entry.color, &entry.depth})
    if (part->in_place) map_locked(part->tile, true);
}

void TileCache::map_locked(const storage::TileRef& tile, bool used) {
  const auto [begin, end] = used ? field_.store().range(tile) : storage::FileRange{};
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
  release_due_ = true;
  mapped_bytes_ = kTreeWindows * kMapWindow;  // these are soon back
  mapped_window_ = kUnlimited;
}

void TileCache::unpin(Entry& entry) {
  const Hold hold(*this);
  unpin_locked(entry);
}

void TileCache::unpin_locked(Entry& entry) {
  if (--entry.pins > 0) return;
  if (entry.color.error || entry.depth.error) {
    drop_locked(entry);
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
    drop_locked(entry);
  }
}

void TileCache::drop_locked(Entry& entry) {
  statistics_.decoded_bytes -= entry.cost;
  dropped_.push_back(entries_.extract(entry.key));
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
