#include "field/tiles/tile_cache.h"

#include <algorithm>
#include <set>
#include <thread>
#include <utility>

#include "base/guarded.h"
#include "base/try.h"
#include "field/geometry/tile_order.h"
#include "field/tiles/compose_samples.h"

namespace slf {

namespace {
constexpr std::uint64_t kTileBytes = 512;  // approximate bookkeeping per tile
// A file declares levels for nothing. What a level needs outside of the budget, memory for its
// geometry and address space for its table, is at most this many times the file. Even an unfinished
// field stays far below.
constexpr std::uint64_t kGeometryTimes = 1 << 10, kTableTimes = 1 << 17;
}  // namespace

TileCache::TileCache(const FieldFile& field, std::uint64_t budget, unsigned state,
                     const std::vector<Structure>* structures)
    : field_(field),
      state_(state),
      composed_(structures != nullptr),
      budget_(structures ? budget / 2 : budget),
      memory_(budget_),
      tiles_(budget_) {
  if (structures)
    for (const Structure& one : *structures)
      parts_.push_back(
          {std::make_unique<TileCache>(one.field.file(), (budget - budget_) / structures->size(),
                                       one.field.state()),
           layer_factor(one.opacity, one.tint, one.field.linear())});
  const FieldShape& shape = field.shape();
  const std::uint64_t bytes = field.store().file_bytes();
  const auto fits = [&](std::uint64_t needed, std::uint64_t times) {
    return needed <= budget || needed / times <= bytes;
  };
  for (unsigned level = 0; level <= shape.finest_level; ++level) {
    const std::uint64_t entries = section_count(level + shape.entry_extra_levels);
    const bool plausible =
        fits(LevelGeometry::memory(shape, level), kGeometryTimes) &&
        fits(tile_count(level, shape.entry_extra_levels) * sizeof(TilePage), kTableTimes);
    tables_.push_back(plausible ? PageTable::make(entries, section_count(level)) : PageTable());
  }
}
TileCache::~TileCache() = default;

/// Holds the lock. After unlocking, frees garbage.
class TileCache::ScopedLock {
 public:
  explicit ScopedLock(TileCache& cache) : cache_(cache), lock_(cache.mutex_) {}
  ~ScopedLock() {
    const LoadedTile::List garbage = cache_.tiles_.take_garbage();
    lock_.unlock();
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

storage::TileState TileCache::Pin::state() const { return tile_->ref.state; }
ByteSpan TileCache::Pin::samples() const {
  return tile_->first ? ByteSpan(tile_->first, tile_->bytes) : ByteSpan();
}

void TileCache::unpin(LoadedTile& tile) {
  if (lost()) return;
  const ScopedLock scoped(*this);
  tiles_.unpin(tile, now());
}

// Frames.

std::uint32_t TileCache::begin_frame(bool lists_tiles) {
  const std::lock_guard lock(mutex_);
  const bool shares = !lists_tiles && tiles_.ample();
  if (shares && shared_) return now();
  shared_ = shares;
  const std::uint32_t frame = ++clock_;
  if (frame % TilePage::kStamps == 0) tiles_.clear_stamps();
  return frame;
}

std::uint32_t TileCache::resume_frame(std::uint32_t frame) {
  const bool ample = [&] {
    const std::lock_guard lock(mutex_);
    return tiles_.ample();
  }();
  return ample ? frame : begin_frame();
}

bool TileCache::has_room(std::uint32_t frame) {
  const ScopedLock scoped(*this);
  if (tiles_.ample()) return true;
  const LoadedTile* const tile = tiles_.least_recently_used();
  return tile && tile->listed < frame;
}

// Loading.

FoundTiles TileCache::find(std::span<const TileKey> keys) {
  // What the parts find is in memory when they look for it again.
  for (const Part& part : parts_) (void)part.cache->find(in_state(keys, part.cache->state()));
  if (composed_) return {};
  return field_.find(keys, [&](TileKey key) {
    const std::lock_guard lock(mutex_);
    return tiles_.find(key) != nullptr;
  });
}

Result<std::vector<TileCache::Pin>> TileCache::load(std::span<const TileKey> keys,
                                                    const FoundTiles& found) {
  const AtWork at_work(AtWork::Kind::inner);
  SLF_TRY(check_kept());
  struct Counted {
    std::atomic<std::uint32_t>& count;
    explicit Counted(std::atomic<std::uint32_t>& of) : count(of) { ++count; }
    ~Counted() { --count; }
  };
  const Counted counted(loading_);
  return load_level(keys, found);
}

Result<TileCache::Pin> TileCache::load(TileKey key, const FoundTiles& found) {
  auto pins = SLF_TRY(load({&key, 1}, found));
  return std::move(pins.front());
}

Result<std::vector<TileCache::Pin>> TileCache::load_level(std::span<const TileKey> keys,
                                                          const FoundTiles& found) {
  std::vector<Pin> pins(keys.size());
  const std::vector<std::size_t> absent = pin_loaded(keys, pins);
  for (auto left = std::span(absent); !left.empty();) {
    const Batch batch = next_batch(keys, left, found);
    // An error is not lost: it is met again when a tile is decoded.
    const auto references = load_level(batch.references, found);
    for (const std::size_t k : left.first(batch.tiles)) pins[k] = SLF_TRY(load_one(keys[k], found));
    left = left.subspan(batch.tiles);
  }
  return pins;
}

std::vector<std::size_t> TileCache::pin_loaded(std::span<const TileKey> keys, std::span<Pin> pins) {
  std::vector<std::size_t> absent;
  const ScopedLock scoped(*this);
  for (std::size_t k = 0; k < keys.size(); ++k) {
    LoadedTile* const tile = tiles_.find(keys[k]);
    if (!tile || tile->stage != LoadedTile::Stage::done || tile->error) {
      absent.push_back(k);
      continue;
    }
    tiles_.pin(*tile);
    pins[k] = Pin(this, tile);
  }
  return absent;
}

TileCache::Batch TileCache::next_batch(std::span<const TileKey> keys,
                                       std::span<const std::size_t> absent,
                                       const FoundTiles& found) {
  if (composed_ || !field_.predicts()) return {absent.size(), {}};
  const auto cost = [&](TileKey key) { return field_.tile_shape(key).bytes() + kTileBytes; };
  const std::uint64_t room = [&] {
    const std::lock_guard lock(mutex_);
    return tiles_.room() / loading_;
  }();
  std::set<TileKey> references;
  std::uint64_t bytes = 0;
  std::size_t count = 0;
  for (const std::size_t k : absent) {
    std::vector<TileKey> added;
    if (const auto tile = found.find(keys[k]); tile != found.end())
      for (const TileKey reference : tile->second.references)
        if (!references.contains(reference)) added.push_back(reference);
    bytes += cost(keys[k]);
    for (const TileKey key : added) bytes += cost(key);
    if (count > 0 && bytes > room) break;
    references.insert(added.begin(), added.end());
    ++count;
  }
  return {count, {references.begin(), references.end()}};
}

Result<void> TileCache::check_kept() const {
  if (!lost()) return {};
  return fail(ErrorCode::failed, field_.path(),
              ": this process was forked while threads read the field; open it again");
}

Result<void> TileCache::check_level(unsigned level) const {
  SLF_TRY(check_kept());
  if (tables_[level]) return {};
  return fail_without("memory", ErrorCode::unsupported, field_.path(), ": level ", level, ": its ",
                      tile_count(level, field_.shape().entry_extra_levels),
                      " tiles need larger tables than there is memory for, and than a file of ",
                      field_.store().file_bytes(), " bytes can fill");
}

Result<TileCache::Pin> TileCache::load_one(TileKey key, const FoundTiles& found) {
  using Stage = LoadedTile::Stage;
  Pin pin;  // ends after the lock
  ScopedLock scoped(*this);
  SLF_TRY(check_level(key.level));
  LoadedTile* tile = tiles_.find(key);
  if (!tile) {
    const auto sections = sections_of(key, field_.shape().entry_extra_levels);
    const bool listed = key.state == state_;
    tile = &tiles_.add(
        key, listed ? tables_[key.level].find(sections.entry.index, sections.exit.index) : nullptr);
  }
  tiles_.pin(*tile);
  pin = Pin(this, tile);
  if (tile->stage == Stage::absent) {
    tile->stage = Stage::loading;
    scoped.lock().unlock();
    auto ok = guarded([&] { return load_samples(*tile, found); });
    scoped.lock().lock();
    tile->stage = Stage::done;
    if (ok)
      publish_locked(*tile);
    else
      tile->error = std::move(ok.error());  // removed with the tile's last pin
    loaded_.notify_all();
  } else {
    loaded_.wait(scoped.lock(), [&] { return tile->stage == Stage::done; });
  }
  if (tile->error) return tl::unexpected(*tile->error);
  return pin;
}

void TileCache::publish_locked(LoadedTile& tile) {
  std::uint32_t state = TilePage::kLoaded;
  if (tile.ref.state == storage::TileState::missing) state |= TilePage::kMissing;
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

Result<void> TileCache::compose(LoadedTile& tile) {
  using storage::TileState;
  std::vector<Pin> pins;
  std::vector<TileLayer> layers;
  tile.ref.state = TileState::empty;
  for (const Part& part : parts_) {
    Pin loaded = SLF_TRY(part.cache->load(in_state(tile.key, part.cache->state())));
    const Pin& pin = pins.emplace_back(std::move(loaded));
    if (pin.state() == TileState::missing) tile.ref.state = TileState::missing;
    if (!pin.samples().empty()) layers.push_back({pin.samples(), part.factor});
  }
  if (layers.empty() || tile.ref.state == TileState::missing) {
    charge(tile, 0);
    return {};
  }
  tile.ref.state = TileState::stored;
  const std::size_t bytes = layers.front().samples.size();
  charge(tile, bytes);
  compose_samples(layers, field_.format(), allocate(tile, bytes));
  return {};
}

std::span<std::byte> TileCache::allocate(LoadedTile& tile, std::size_t bytes) {
  tile.owned = memory_.allocate(kReadableBefore + bytes);
  std::byte* const first = tile.owned.get() + kReadableBefore;
  tile.first = first;
  tile.bytes = bytes;
  return {first, bytes};
}

Result<void> TileCache::load_samples(LoadedTile& tile, const FoundTiles& found) {
  if (composed_) return compose(tile);
  const storage::TileStore& store = field_.store();
  const auto known = found.find(tile.key);
  const bool is_known = known != found.end();
  tile.ref = SLF_TRY(is_known ? known->second.ref : store.find(tile.key));
  if (tile.ref.state != storage::TileState::stored) {
    charge(tile, 0);
    return {};
  }
  SLF_TRY(store.check(tile.ref));  // before what the payload names is loaded
  auto listed = is_known ? known->second.references : field_.references(tile.ref);
  const auto references = SLF_TRY(std::move(listed));
  std::vector<Pin> pins;
  std::vector<ReferenceSamples> from;
  for (const TileKey reference : references) {
    Pin loaded = SLF_TRY(load_one(reference, found));
    const Pin& pin = pins.emplace_back(std::move(loaded));
    from.push_back({reference, pin.samples()});
    if (reference.level == tile.key.level) {
      tile.chain = pin.tile_->chain + 1;
      if (tile.chain > kMaxChain)
        return fail(ErrorCode::bad_file, field_.place(tile.key), kChained);
    }
    if (pin.state() != storage::TileState::missing) continue;
    tile.lacking = pin.tile_->lacking.value_or(reference);
    tile.ref.state = storage::TileState::missing;
    charge(tile, 0);
    return {};
  }
  const std::size_t bytes = field_.tile_shape(tile.key).bytes();
  charge(tile, bytes);
  payload_bytes_ += tile.ref.payload.size();
  return field_.decode(tile.ref, from, allocate(tile, bytes));
}

void TileCache::charge(LoadedTile& tile, std::uint64_t bytes) {
  ScopedLock scoped(*this);
  const std::uint64_t cost = bytes + kTileBytes;
  while (tiles_.remove_for(cost)) {  // again after a wait: others may have charged for tiles
    scoped.lock().unlock();
    std::this_thread::yield();  // frames that use removed tiles end soon
    scoped.lock().lock();
  }
  tiles_.set_cost(tile, cost);
  statistics_.decodes += bytes > 0 && !composed_;
  statistics_.decoded_peak_bytes = std::max(statistics_.decoded_peak_bytes, tiles_.bytes());
}

Result<TileCache::Pin> TileCache::read(TileKey key, const FoundTiles& found) {
  auto pin = SLF_TRY(load(key, found));
  if (const auto& lacking = pin.tile_->lacking)
    return fail(ErrorCode::tile_missing, field_.place(*lacking),
                ", from which others are predicted, is missing; build the field again");
  return pin;
}

Result<void> TileCache::read(TileKey key, Bytes& samples) {
  const auto pin = SLF_TRY(read(key));
  samples.assign(pin.samples().begin(), pin.samples().end());
  samples.resize(field_.tile_shape(key).bytes());
  return {};
}

// Statistics.

CacheStatistics TileCache::statistics() const {
  const std::lock_guard lock(mutex_);
  CacheStatistics statistics = statistics_;
  statistics.decoded_bytes = tiles_.bytes();
  statistics.loaded_bytes = payload_bytes_;
  for (const Part& part : parts_) {
    const CacheStatistics more = part.cache->statistics();
    statistics.decodes += more.decodes;
    statistics.decoded_bytes += more.decoded_bytes;
    statistics.decoded_peak_bytes += more.decoded_peak_bytes;
    statistics.loaded_bytes += more.loaded_bytes;
  }
  return statistics;
}

void TileCache::reset_peak() {
  for (const Part& part : parts_) part.cache->reset_peak();
  const std::lock_guard lock(mutex_);
  statistics_.decoded_peak_bytes = tiles_.bytes();
}

}  // namespace slf
