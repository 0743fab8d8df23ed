#include "field/reference_cache.h"

namespace slf {

namespace {
constexpr std::uint64_t kEntryBytes = 128;  // approximate bookkeeping per entry

std::uint64_t cost(const TileSamples& samples) {
  return kEntryBytes + (samples ? samples->size() : 0);
}
}  // namespace

Result<TileSamples> ReferenceCache::get(TileKey key) {
  std::unique_lock lock(mutex_);
  auto place = places_.find(key);
  while (place != places_.end() && place->second->loading) {
    loaded_.wait(lock);
    place = places_.find(key);
  }
  if (place != places_.end()) {
    entries_.splice(entries_.end(), entries_, place->second);
    return place->second->samples;
  }
  const auto entry = entries_.insert(entries_.end(), {key, nullptr, true});
  places_[key] = entry;
  lock.unlock();
  const auto forget = [&] {  // others wait for the tile
    lock.lock();
    loaded_.notify_all();
    places_.erase(key);
    entries_.erase(entry);
  };
  Result<TileSamples> samples;
  try {
    samples = load_(key);
  } catch (...) {  // no memory, say: not an error of the tile
    forget();
    throw;
  }
  if (!samples) {  // errors are not cached: the next request tries again
    forget();
    return samples;
  }
  lock.lock();
  loaded_.notify_all();
  entry->samples = *samples;
  entry->loading = false;
  bytes_ += cost(*samples);
  evict_locked();
  return samples;
}

bool ReferenceCache::has(TileKey key) {
  const std::lock_guard lock(mutex_);
  return places_.contains(key);
}

void ReferenceCache::set_budget(std::uint64_t bytes) {
  const std::lock_guard lock(mutex_);
  budget_ = bytes;
  evict_locked();
}

void ReferenceCache::evict_locked() {
  for (auto entry = entries_.begin(); entry != entries_.end() && bytes_ > budget_;) {
    if (entry->loading) {
      ++entry;
      continue;
    }
    bytes_ -= cost(entry->samples);
    places_.erase(entry->key);
    entry = entries_.erase(entry);
  }
}

}  // namespace slf
