#include "field/tiles/tile_cache.h"

#include <algorithm>
#include <optional>
#include <set>
#include <thread>
#include <utility>

#include "base/guarded.h"
#include "base/try.h"
#include "field/geometry/section.h"

namespace slf {

namespace {
constexpr std::uint64_t kTileBytes = 512;      // approximate bookkeeping per tile
constexpr std::uint64_t kMapWindow = 1 << 16;  // what Linux maps around a page that is read
constexpr std::uint64_t kTreeWindows = 3;      // approximate, on the way through the tree
// A file declares levels for nothing. What a level needs outside of the budget, memory for its
// geometry and address space for its table, is at most this many times the file. Even an unfinished
// field stays far below.
constexpr std::uint64_t kGeometryTimes = 1 << 10, kTableTimes = 1 << 17;
}  // namespace

struct TileCache::Tile {
  enum class Stage : std::uint8_t { absent, loading, done };

  TileKey key;
  TilePage* page = nullptr;  // where readers find it
  storage::TileRef ref;
  const std::byte* first = nullptr;
  TileMemory::Block owned;         // what `first` points into, unless it is the map
  std::size_t bytes = 0;           // of the samples
  std::optional<TileKey> lacking;  // a tile that this one is predicted from, but was never built
  std::optional<Error> error;
  Stage stage = Stage::absent;
  bool in_place = false;     // the samples are in the map
  bool mapped = false;       // the payload is read through the map
  std::uint64_t cost = 0;    // bytes that it counts in the budget
  std::uint32_t listed = 0;  // page.used when it last came into idle_
  std::uint32_t pins = 0;    // 0: in idle_
  std::uint64_t epoch = 0;   // of its removal
  Tiles::iterator place;     // in its list
};

TileCache::TileCache(const FieldFile& field, std::uint64_t budget, std::uint64_t map_budget,
                     bool in_place)
    : field_(field),
      budget_(budget),
      map_budget_(map_budget),
      in_place_(in_place),
      memory_(budget) {
  const FieldShape& shape = field.shape();
  const std::uint64_t bytes = field.store().file_bytes();
  const auto fits = [&](std::uint64_t needed, std::uint64_t times) {
    return needed <= budget || needed / times <= bytes;
  };
  for (unsigned level = 0; level <= shape.levels; ++level) {
    const std::uint64_t entries = section_count(level + shape.entry_extra_levels);
    const bool plausible =
        fits(LevelGeometry::memory(shape, level), kGeometryTimes) &&
        fits(tile_count(level, shape.entry_extra_levels) * sizeof(TilePage), kTableTimes);
    tables_.push_back(plausible ? PageTable::make(entries, section_count(level)) : PageTable());
  }
}
TileCache::~TileCache() = default;

/// Holds the lock. After unlocking, frees garbage_ and releases the map if that is due.
class TileCache::ScopedLock {
 public:
  explicit ScopedLock(TileCache& cache) : cache_(cache), lock_(cache.mutex_) {}
  ~ScopedLock() {
    Tiles garbage;
    garbage.swap(cache_.garbage_);
    const bool release = std::exchange(cache_.release_due_, false);
    lock_.unlock();
    if (release) cache_.field_.store().release_all();
  }

  [[nodiscard]] std::unique_lock<std::mutex>& lock() { return lock_; }

 private:
  TileCache& cache_;
  std::unique_lock<std::mutex> lock_;
};

// Pins.

TileCache::Pin& TileCache::Pin::operator=(Pin&& other) noexcept {
  if (this != &other) {
    release();
    cache_ = other.cache_;
    tile_ = std::exchange(other.tile_, nullptr);
  }
  return *this;
}

void TileCache::Pin::release() {
  if (tile_) cache_->unpin(*std::exchange(tile_, nullptr));
}

TilePage& TileCache::Pin::page() const { return *tile_->page; }
storage::TileState TileCache::Pin::state() const { return tile_->ref.state; }
ByteSpan TileCache::Pin::samples() const {
  return tile_->first ? ByteSpan(tile_->first, tile_->bytes) : ByteSpan();
}

void TileCache::pin_locked(Tile& tile) {
  if (tile.pins++ > 0) return;
  pinned_.splice(pinned_.end(), idle_, tile.place);
  pinned_bytes_ += tile.cost;
  if (tile.in_place) count_mapped_locked(tile.ref, true);
}

void TileCache::unpin(Tile& tile) {
  const ScopedLock scoped(*this);
  unpin_locked(tile);
  remove_for_locked(0);
  free_removed_locked();
}

void TileCache::unpin_locked(Tile& tile) {
  if (--tile.pins > 0) return;
  pinned_bytes_ -= tile.cost;
  idle_.splice(idle_.end(), pinned_, tile.place);
  if (tile.error) return remove_locked(tile);
  tile.listed = now();
  tile.page->used.store(tile.listed, std::memory_order_relaxed);
}

// Readers.

TileCache::Reader::Reader(TileCache& cache) : cache_(cache) {
  const std::lock_guard lock(cache.mutex_);
  for (Slot& slot : cache.readers_)
    if (!slot.taken) {
      slot_ = &slot;
      slot.taken = true;
      return;
    }
  slot_ = &cache.readers_.emplace_back();
  slot_->taken = true;
}

TileCache::Reader::~Reader() {
  const std::lock_guard lock(cache_.mutex_);
  slot_->taken = false;
}

TileCache::ReadScope::ReadScope(Reader& reader) : reader_(reader) {
  // If a remover does not see this epoch, this thread sees its removal: the fence orders the store
  // before loads of pages, and free_removed_locked()'s orders removals before loads of epochs.
  reader.slot_->epoch.store(reader.cache_.epoch_.load(std::memory_order_acquire),
                            std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_seq_cst);
}

TileCache::ReadScope::~ReadScope() { reader_.slot_->epoch.store(0, std::memory_order_release); }

std::uint32_t TileCache::begin_frame(bool lists_tiles) {
  const std::lock_guard lock(mutex_);
  const bool shares = !lists_tiles && ample_locked();
  if (shares && shared_) return now();
  shared_ = shares;
  const std::uint32_t frame = ++clock_;
  if (frame % TilePage::kStamps == 0)
    for (const auto& [key, tile] : tiles_) tile->page->found.fetch_and(~TilePage::kStampMask);
  return frame;
}

// Removal.

TileCache::Tile* TileCache::least_recently_used_locked() {
  while (!idle_.empty()) {
    Tile& tile = idle_.front();
    const std::uint32_t used = tile.page->used.load(std::memory_order_relaxed);
    if (used == tile.listed) return &tile;
    tile.listed = used;  // a frame has used it since
    idle_.splice(idle_.end(), idle_, tile.place);
  }
  return nullptr;
}

void TileCache::remove_locked(Tile& tile) {
  tile.page->found.fetch_or(TilePage::kRemoved);
  tile.page->state.store(0, std::memory_order_release);
  tile.epoch = 1 + epoch_.fetch_add(1, std::memory_order_seq_cst);
  removed_bytes_ += tile.cost;
  tiles_.erase(tile.key);
  removed_.splice(removed_.end(), idle_, tile.place);
}

void TileCache::free_removed_locked() {
  if (removed_.empty()) return;
  std::atomic_thread_fence(std::memory_order_seq_cst);
  std::uint64_t oldest = kUnlimited;
  for (const Reader::Slot& slot : readers_)
    if (const std::uint64_t epoch = slot.epoch.load(std::memory_order_acquire))
      oldest = std::min(oldest, epoch);
  while (!removed_.empty() && removed_.front().epoch <= oldest) {
    const std::uint64_t cost = removed_.front().cost;
    removed_bytes_ -= cost;
    statistics_.decoded_bytes -= cost;
    garbage_.splice(garbage_.end(), removed_, removed_.begin());
  }
}

void TileCache::remove_for_locked(std::uint64_t bytes) {
  while (statistics_.decoded_bytes - removed_bytes_ + bytes > budget_) {
    Tile* const tile = least_recently_used_locked();
    if (!tile) return;  // all others are pinned
    remove_locked(*tile);
  }
}

void TileCache::make_room(std::unique_lock<std::mutex>& lock, std::uint64_t bytes) {
  for (;;) {
    remove_for_locked(bytes);  // again after a wait: other threads may have charged for tiles
    free_removed_locked();
    if (removed_.empty() || statistics_.decoded_bytes + bytes <= budget_) return;
    lock.unlock();
    std::this_thread::yield();  // frames that use removed tiles end soon
    lock.lock();
  }
}

bool TileCache::ample_locked() const { return statistics_.decoded_bytes < budget_ - budget_ / 8; }

std::uint32_t TileCache::resume_frame(std::uint32_t frame) {
  const bool ample = [&] {
    const std::lock_guard lock(mutex_);
    return ample_locked();
  }();
  return ample ? frame : begin_frame();
}

bool TileCache::has_room(std::uint32_t frame) {
  const ScopedLock scoped(*this);
  if (ample_locked()) return true;
  const Tile* const tile = least_recently_used_locked();
  return tile && tile->listed < frame;
}

// Loading.

Result<std::vector<TileCache::Pin>> TileCache::load(std::span<const TileKey> keys) {
  return load_all(locate(keys));
}

Result<TileCache::Pin> TileCache::load(const Located& tile) {
  auto pins = SLF_TRY(load_all({tile}));
  return std::move(pins.front());
}

Result<std::vector<TileCache::Pin>> TileCache::load_all(std::vector<Located> tiles) {
  struct Counted {
    std::atomic<std::uint32_t>& count;
    explicit Counted(std::atomic<std::uint32_t>& of) : count(of) { ++count; }
    ~Counted() { --count; }
  };
  const Counted counted(loading_);
  return load_level(std::move(tiles));
}

Result<std::vector<TileCache::Pin>> TileCache::load_level(std::vector<Located> tiles) {
  std::vector<Pin> pins(tiles.size());
  const std::vector<std::size_t> absent = pin_loaded(tiles, pins);
  for (auto left = std::span(absent); !left.empty();) {
    const Batch batch = next_batch(tiles, left);
    // An error is not lost: it is met again when a tile is decoded.
    const auto references = load_level(find(batch.references, false));
    for (const std::size_t k : left.first(batch.tiles)) pins[k] = SLF_TRY(load_one(tiles[k]));
    left = left.subspan(batch.tiles);
  }
  return pins;
}

std::vector<std::size_t> TileCache::pin_loaded(std::span<const Located> tiles,
                                               std::span<Pin> pins) {
  std::vector<std::size_t> absent;
  const ScopedLock scoped(*this);
  for (std::size_t k = 0; k < tiles.size(); ++k) {
    const auto found = tiles_.find(tiles[k].key);
    Tile* const tile = found == tiles_.end() ? nullptr : &*found->second;
    if (!tile || tile->stage != Tile::Stage::done || tile->error) {
      absent.push_back(k);
      continue;
    }
    pin_locked(*tile);
    pins[k] = Pin(this, tile);
  }
  return absent;
}

TileCache::Batch TileCache::next_batch(std::span<Located> tiles,
                                       std::span<const std::size_t> absent) {
  if (!field_.predicts()) return {absent.size(), {}};
  const auto cost = [&](TileKey key) { return field_.tile_shape(key).bytes() + kTileBytes; };
  const std::uint64_t room = [&] {
    const std::lock_guard lock(mutex_);
    return (budget_ - std::min(budget_, pinned_bytes_)) / loading_;
  }();
  std::set<TileKey> references;
  std::uint64_t bytes = 0;
  std::size_t count = 0;
  for (const std::size_t k : absent) {
    std::vector<TileKey> added;
    for (const TileKey key : references_of(tiles[k]))
      if (!references.contains(key)) added.push_back(key);
    bytes += cost(tiles[k].key);
    for (const TileKey key : added) bytes += cost(key);
    if (count > 0 && bytes > room) break;
    references.insert(added.begin(), added.end());
    ++count;
  }
  return {count, {references.begin(), references.end()}};
}

std::vector<TileKey> TileCache::references_of(Located& tile) const {
  if (!tile.ref)
    if (const auto found = field_.store().find(tile.key)) tile.ref = *found;
  // A payload that cannot be read names none; load_one() reports the error.
  if (!tile.ref || tile.ref->state != storage::TileState::stored ||
      !field_.store().fetch(*tile.ref))
    return {};
  std::vector<TileKey> keys = field_.references(*tile.ref);
  std::erase_if(keys, [&](TileKey key) { return !field_.shape().has(key); });
  return keys;
}

Result<void> TileCache::check_level(unsigned level) const {
  if (tables_[level]) return {};
  return fail_without("memory", ErrorCode::unsupported, field_.path(), ": level ", level, ": its ",
                      tile_count(level, field_.shape().entry_extra_levels),
                      " tiles need larger tables than there is memory for, and than a file of ",
                      field_.store().file_bytes(), " bytes can fill");
}

Result<TileCache::Pin> TileCache::load_one(const Located& located) {
  Pin pin;  // ends after the lock
  ScopedLock scoped(*this);
  SLF_TRY(check_level(located.key.level));
  auto place = tiles_.find(located.key);
  if (place == tiles_.end()) {
    const auto sections = sections_of(located.key, field_.shape().entry_extra_levels);
    Tiles made(1);
    Tile& tile = made.front();
    tile.key = located.key;
    tile.page = tables_[located.key.level].find(sections.entry.index, sections.exit.index);
    tile.place = made.begin();
    place = tiles_.emplace(located.key, tile.place).first;
    idle_.splice(idle_.end(), made);
  }
  Tile& tile = *place->second;
  pin_locked(tile);
  pin = Pin(this, &tile);
  SLF_TRY(load_once(scoped.lock(), tile, located.ref));
  return pin;
}

Result<void> TileCache::load_once(std::unique_lock<std::mutex>& lock, Tile& tile,
                                  const std::optional<storage::TileRef>& located) {
  using Stage = Tile::Stage;
  if (tile.stage == Stage::absent) {
    tile.stage = Stage::loading;
    lock.unlock();
    auto ok = guarded([&] { return load_samples(tile, located); });
    lock.lock();
    tile.stage = Stage::done;
    if (ok)
      publish_locked(tile);
    else
      tile.error = std::move(ok.error());  // removed with the tile's last pin
    loaded_.notify_all();
  } else {
    loaded_.wait(lock, [&] { return tile.stage == Stage::done; });
  }
  if (tile.error) return tl::unexpected(*tile.error);
  return {};
}

void TileCache::publish_locked(Tile& tile) {
  std::uint32_t state = TilePage::kLoaded;
  if (tile.ref.state == storage::TileState::missing) state |= TilePage::kMissing;
  // If the map has a budget, samples in the map must be pinned: pinning counts their pages.
  if (map_budget_ != kUnlimited && tile.in_place) state |= TilePage::kMustPin;
  TilePage& page = *tile.page;
  page.color.store(tile.first, std::memory_order_release);
  const std::byte* depths = nullptr;  // they come after all colours
  if (tile.first && field_.has_depth())
    depths = tile.first + field_.tile_shape(tile.key).color_bytes();
  page.depth.store(depths, std::memory_order_release);
  page.found.store(TilePage::found_word(sample_offset(tile.first), TilePage::kNotFound),
                   std::memory_order_release);
  page.used.store(now(), std::memory_order_relaxed);
  page.state.store(state, std::memory_order_release);
}

void TileCache::charge(Tile& tile, std::uint64_t bytes, bool located) {
  ScopedLock scoped(*this);
  const std::uint64_t cost = bytes + kTileBytes;
  make_room(scoped.lock(), cost);
  tile.cost = cost;
  pinned_bytes_ += cost;  // who loads it has pinned it
  statistics_.decodes += bytes > 0;
  if (tile.in_place) statistics_.loaded_bytes += tile.ref.payload.size();
  if (tile.mapped || !located) count_mapped_locked(tile.ref, tile.mapped);
  statistics_.decoded_bytes += cost;
  statistics_.decoded_peak_bytes =
      std::max(statistics_.decoded_peak_bytes, statistics_.decoded_bytes);
}

Result<void> TileCache::load_samples(Tile& tile, const std::optional<storage::TileRef>& located) {
  const auto ref = SLF_TRY(located ? *located : field_.store().find(tile.key));
  tile.ref = ref;
  const bool stored = ref.state == storage::TileState::stored;
  const std::size_t bytes = stored ? field_.tile_shape(tile.key).bytes() : 0;
  const bool raw = stored && field_.codec().in_place() && ref.payload.size() == bytes;
  tile.in_place = in_place_ && raw;
  tile.mapped = stored && (tile.in_place || !raw);
  charge(tile, tile.in_place ? 0 : bytes, located.has_value());
  if (tile.in_place) {
    tile.bytes = bytes;
    tile.first = ref.payload.data();  // a record's table comes before any payload
    return field_.store().check(ref);
  }
  if (!stored) return {};
  tile.owned = memory_.allocate(kReadableBefore + bytes);
  std::byte* const first = tile.owned.get() + kReadableBefore;
  tile.first = first;
  tile.bytes = bytes;
  payload_bytes_ += ref.payload.size();
  std::vector<Pin> pins;
  auto decoded = field_.decode(ref, references(pins, tile.lacking), {first, bytes});
  if (!tile.lacking) return decoded;
  tile.ref.state = storage::TileState::missing;
  tile.first = nullptr;
  return {};
}

ReferenceSource TileCache::references(std::vector<Pin>& pins, std::optional<TileKey>& lacking) {
  return [&, this](TileKey key) -> Result<ByteSpan> {
    if (!field_.shape().has(key))
      return fail(ErrorCode::bad_file, field_.path(), ": tile ", int{key.level}, "/", key.index,
                  ", from which others are predicted, is not in the field");
    auto loaded = SLF_TRY(load_one(Located{key}));
    const Pin& pin = pins.emplace_back(std::move(loaded));
    if (pin.state() != storage::TileState::missing) return pin.samples();
    lacking = pin.tile_->lacking.value_or(key);
    return fail(ErrorCode::tile_missing, "a reference");
  };
}

Result<TileCache::Pin> TileCache::read(const storage::TileRef& tile) {
  auto pin = SLF_TRY(load(Located{tile.key, tile}));
  if (const auto& lacking = pin.tile_->lacking)
    return fail(ErrorCode::tile_missing, field_.path(), ": tile ", int{lacking->level}, "/",
                lacking->index,
                ", from which others are predicted, is missing; build the field again");
  return pin;
}

Result<void> TileCache::read(const storage::TileRef& tile, std::span<std::byte> samples) {
  const auto pin = SLF_TRY(read(tile));
  std::ranges::copy(pin.samples(), samples.begin());
  return {};
}

Result<void> TileCache::encode(TileKey key, ByteSpan samples, Bytes& payload) {
  std::vector<Pin> pins;
  std::optional<TileKey> lacking;
  return field_.coder().encode(key, samples, references(pins, lacking), payload);
}

std::vector<TileCache::Located> TileCache::locate(std::span<const TileKey> keys) {
  return find(keys, true);
}

std::vector<TileCache::Located> TileCache::find(std::span<const TileKey> keys, bool advise) {
  std::vector<Located> located(keys.size());
  std::vector<TileKey> absent;
  std::vector<std::size_t> places;  // indices of the absent ones in `keys`
  {
    const std::lock_guard lock(mutex_);
    for (std::size_t k = 0; k < keys.size(); ++k) {
      located[k].key = keys[k];
      if (tiles_.contains(keys[k])) continue;
      absent.push_back(keys[k]);
      places.push_back(k);
    }
  }
  // Find all in one batch, unless the tables of so many records would exceed the map's budget.
  const std::size_t max_batch = std::max<std::uint64_t>(map_budget_ / (4 * kMapWindow), 1);
  for (std::size_t begin = 0; begin < absent.size(); begin += max_batch) {
    const auto some = std::span(absent).subspan(begin, std::min(max_batch, absent.size() - begin));
    std::vector<storage::TileRef> refs;
    const auto found = field_.store().find_all(some);
    for (std::size_t k = 0; k < found.size(); ++k) {
      if (!found[k]) continue;  // load() reports the error
      located[places[begin + k]].ref = *found[k];
      refs.push_back(*found[k]);
    }
    if (advise)
      field_.advise(refs, [this](TileKey key) {
        const std::lock_guard lock(mutex_);
        return tiles_.contains(key);
      });
    const ScopedLock scoped(*this);
    for (const storage::TileRef& ref : refs) count_mapped_locked(ref, false);
  }
  return located;
}

void TileCache::count_mapped_locked(const storage::TileRef& tile, bool read) {
  const auto [begin, end] = read ? field_.store().range(tile) : storage::FileRange{};
  // Finding a tile maps two windows: its record's table and a leaf of the tree. A payload next to
  // the one read last shares them.
  std::uint64_t windows = 2;
  if (begin < end) {
    const std::uint64_t first = begin / kMapWindow, last = (end - 1) / kMapWindow;
    windows = last - first + (first == mapped_window_ ? 0 : 3);
    mapped_window_ = last;
  }
  mapped_bytes_ += windows * kMapWindow;
  if (mapped_bytes_ <= map_budget_) return;
  release_due_ = true;
  mapped_bytes_ = kTreeWindows * kMapWindow;  // the tree's pages are soon read again
  mapped_window_ = kUnlimited;
}

// Statistics.

CacheStatistics TileCache::statistics() const {
  const std::lock_guard lock(mutex_);
  CacheStatistics statistics = statistics_;
  statistics.loaded_bytes += payload_bytes_;
  return statistics;
}

void TileCache::reset_peak() {
  const std::lock_guard lock(mutex_);
  statistics_.decoded_peak_bytes = statistics_.decoded_bytes;
}

}  // namespace slf
