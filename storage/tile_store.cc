#include "storage/tile_store.h"

#include <sys/mman.h>

#include <algorithm>
#include <numeric>
#include <utility>

#include "base/sort_unique.h"
#include "base/try.h"
#include "storage/internal/prefetch.h"
#include "storage/internal/snapshot.h"
#include "storage/internal/structure.h"

namespace slf::storage {

using internal::Cursor;
using internal::Record;
using internal::Snapshot;

namespace {

// The smallest key above `key`, unless that is the last one of its state.
TileKey after(TileKey key) { return {key.level, key.index + 1, key.state}; }

TileRef tile_ref(const Record& record, std::uint32_t position, const internal::Tile& tile) {
  const TileKey key = record.key(position);
  return {tile.state, key, tile.payload, tile.checksum, tile.source(key)};
}

// Walks the records from a key on, and accounts for every key. Reports as damage the keys of
// damaged records, and those of lost records, which the next record's previous key reveals.
class RecordWalk {
 public:
  RecordWalk(const Snapshot& snapshot, TileKey from, TileKey to)
      : snapshot_(snapshot), cursor_(snapshot.pages(), snapshot.tiles()), next_(from), to_(to) {}

  // `visit` and `damaged` return whether to continue.
  template <class Visit, class Damaged>
  void run(const Visit& visit, const Damaged& damaged) {
    auto at = cursor_.seek(internal::encode_key(next_));
    for (; !at || *at; at = cursor_.next()) {
      if (!at) {
        if (!cause_) cause_ = std::move(at.error());
        continue;
      }
      if (cursor_.leaf().number() != leaf_) {
        leaf_ = cursor_.leaf().number();
        internal::prefetch_heads(snapshot_.pages(), cursor_, to_);
      }
      auto record = snapshot_.record(cursor_);
      if (!record) {
        const auto last = internal::decode_key(cursor_.key());
        if (!cause_) cause_ = std::move(record.error());
        if (!last || *last < next_) continue;
        if (!report(*last, damaged) || next_ >= to_) return;
        continue;
      }
      if (record->previous() && *record->previous() >= next_ &&
          !report(*record->previous(), damaged))
        return;
      cause_.reset();
      if (record->first() >= to_) return;
      if (record->last() < next_) continue;
      if (++records_ % Snapshot::kReleaseEvery == 0) snapshot_.release();
      if (!visit(*record)) return;
      next_ = after(record->last());
      if (next_ >= to_) return;
    }
    const auto& last = snapshot_.container().last;
    if (last && next_ <= *last) (void)report(*last, damaged);
  }

 private:
  template <class Damaged>
  bool report(TileKey last, const Damaged& damaged) {
    if (!cause_) cause_ = Error{ErrorCode::bad_file, snapshot_.path() + ": records are lost"};
    Damage damage{std::move(*cause_), next_, last};
    damage.message += "; tiles " + name(next_) + " to " + name(last);
    cause_.reset();
    next_ = after(last);
    return damaged(damage);
  }

  const Snapshot& snapshot_;
  Cursor cursor_;
  TileKey next_;  ///< the first key not accounted for
  TileKey to_;
  std::uint64_t leaf_ = internal::kNoPage;  ///< the leaf whose records were prefetched
  std::uint64_t records_ = 0;               ///< visited
  std::optional<Error> cause_;
};

void advise_all(const Snapshot& snapshot, std::span<const TileRef> tiles, int advice) {
  internal::Advice parts(snapshot.pages());
  for (const TileRef& tile : tiles) parts.add(tile.payload);
  parts.apply(advice);
}

}  // namespace

Result<TileStore> TileStore::open(const std::string& path) {
  auto snapshot = SLF_TRY(Snapshot::open(path));
  return TileStore(std::move(snapshot));
}
Result<TileStore> TileStore::open(std::shared_ptr<RangeSource> source) {
  auto snapshot = SLF_TRY(Snapshot::open(std::move(source)));
  return TileStore(std::move(snapshot));
}

const std::string& TileStore::path() const { return snapshot_->path(); }
std::uint64_t TileStore::file_bytes() const { return snapshot_->bytes().size(); }
const std::byte* TileStore::map() const { return snapshot_->bytes().data(); }
std::uint64_t TileStore::transaction() const { return snapshot_->meta().transaction; }
Result<void> TileStore::unchanged() const { return snapshot_->unchanged(); }

Result<bool> TileStore::has_blob(std::string_view name) const { return snapshot_->has_blob(name); }

Result<ByteSpan> TileStore::blob(std::string_view name) const { return snapshot_->blob(name); }

bool TileStore::is_remote() const { return snapshot_->is_remote(); }
Bytes TileStore::section(std::uint32_t id) const { return snapshot_->section(id); }

namespace {

TileRef tile_of(const std::optional<Record>& record, TileKey key) {
  if (!record) return {TileState::missing, key};
  const auto position = static_cast<std::uint32_t>(key.index - record->first().index);
  return tile_ref(*record, position, record->tile(position));
}

// A tile that is the same as `source`.
Result<TileRef> same_as(Result<TileRef> source, TileKey key) {
  if (source && source->state != TileState::stored) return TileRef{TileState::missing, key};
  if (source) source->key = key;
  return source;
}

}  // namespace

Result<TileRef> TileStore::find_own(TileKey key) const {
  const auto record = SLF_TRY(snapshot_->find(key));
  return tile_of(record, key);
}

Result<TileRef> TileStore::find(TileKey key) const {
  auto tile = SLF_TRY(find_own(key));
  if (tile.state == TileState::same) tile = SLF_TRY(same_as(find_own(tile.source), key));
  SLF_TRY(snapshot_->unchanged());
  return tile;
}

std::vector<Result<TileRef>> TileStore::find_all(std::span<const TileKey> keys) const {
  auto tiles = find_own(keys);
  std::vector<std::size_t> same;
  std::vector<TileKey> sources;
  for (std::size_t k = 0; k < tiles.size(); ++k)
    if (tiles[k] && tiles[k]->state == TileState::same) {
      same.push_back(k);
      sources.push_back(tiles[k]->source);
    }
  if (!same.empty()) {
    auto found = find_own(sources);
    for (std::size_t i = 0; i < same.size(); ++i)
      tiles[same[i]] = same_as(std::move(found[i]), keys[same[i]]);
  }
  if (auto unchanged = snapshot_->unchanged(); !unchanged)
    for (auto& tile : tiles) tile = tl::unexpected(unchanged.error());
  return tiles;
}

std::vector<Result<TileRef>> TileStore::find_own(std::span<const TileKey> keys) const {
  std::vector<Result<TileRef>> tiles(keys.size());
  std::vector<std::size_t> order(keys.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return keys[a] < keys[b]; });
  const Snapshot& snapshot = *snapshot_;
  std::vector<internal::RecordKey> sorted;
  sorted.reserve(keys.size());
  for (const std::size_t k : order) sorted.push_back(internal::encode_key(keys[k]));
  internal::prefetch_records(snapshot.pages(), snapshot.tiles(), sorted);

  std::optional<Record> record;      // that of the previous tile, and mostly of the next one
  std::optional<Record::Walk> walk;  // of `record`, at the previous tile or after it
  for (const std::size_t k : order) {
    const TileKey key = keys[k];
    if (!record || key < record->first() || key > record->last()) {
      auto found = snapshot.find(key);
      record.reset();
      if (!found) {
        tiles[k] = tl::unexpected(std::move(found.error()));
        continue;
      }
      record = *found;
      walk.reset();
      if (record) walk.emplace(*record);
      if (record) (void)walk->next();
    }
    if (!record) {
      tiles[k] = TileRef{TileState::missing, keys[k]};
      continue;
    }
    const auto position = static_cast<std::uint32_t>(key.index - record->first().index);
    while (walk->position() < position) (void)walk->next();
    tiles[k] = tile_ref(*record, position, walk->tile());
  }
  return tiles;
}

Result<void> TileStore::fetch(const TileRef& tile) const { return snapshot_->fetch(tile.payload); }

Result<void> TileStore::check(const TileRef& tile) const {
  SLF_TRY(fetch(tile));
  if (tile.state != TileState::stored) return {};
  const bool good = payload_checksum(tile.source, tile.payload) == tile.checksum;
  SLF_TRY(snapshot_->unchanged());
  if (good) return {};
  return fail_without("fix", ErrorCode::bad_file, path(), ": tile ", name(tile.source),
                      ": the payload of ", tile.payload.size(),
                      " bytes does not match its checksum");
}

void TileStore::advise(std::span<const TileRef> tiles) const {
  advise_all(*snapshot_, tiles, MADV_WILLNEED);
}
void TileStore::release(std::span<const TileRef> tiles) const {
  advise_all(*snapshot_, tiles, MADV_DONTNEED);
}
void TileStore::release_all() const { snapshot_->release(); }

FileRange TileStore::range(const TileRef& tile) const {
  if (tile.payload.empty()) return {};
  const auto begin = static_cast<std::uint64_t>(tile.payload.data() - map());
  return {begin, begin + tile.payload.size()};
}

Result<std::vector<std::uint64_t>> TileStore::pages(std::span<const TileKey> keys) const {
  const Snapshot& snapshot = *snapshot_;
  constexpr std::uint64_t kSize = internal::kPageSize;
  std::vector<std::uint64_t> pages;
  const auto add = [&](ByteSpan bytes) {
    if (bytes.empty()) return;
    const auto begin = static_cast<std::uint64_t>(bytes.data() - map());
    for (std::uint64_t page = begin / kSize; page * kSize < begin + bytes.size(); ++page)
      pages.push_back(page);
  };
  const auto add_tile = [&](TileKey key) -> Result<TileRef> {
    Cursor cursor(snapshot.pages(), snapshot.tiles());
    if (const auto found = cursor.seek(internal::encode_key(key)); found && *found) {
      cursor.path(pages);
      add(internal::record_head(snapshot.pages(), cursor.leaf(), cursor.index()));
    }
    const auto record = SLF_TRY(snapshot.find(key));
    const TileRef tile = tile_of(record, key);
    add(tile.payload);
    return tile;
  };
  for (const TileKey& key : keys) {
    const auto tile = SLF_TRY(add_tile(key));
    if (tile.state == TileState::same) SLF_TRY(add_tile(tile.source));
  }
  sort_unique(pages);
  return pages;
}

Result<void> TileStore::visit(TileKey from, TileKey to, const Visitor& visitor,
                              const DamageVisitor& damaged) const {
  Result<void> result;
  const auto visit_record = [&](const Record& record) {
    for (Record::Walk walk(record); result && walk.next();) {
      const TileRef tile = tile_ref(record, walk.position(), walk.tile());
      if (tile.key < from || tile.key >= to || tile.state == TileState::missing) continue;
      if (result = snapshot_->unchanged(); result) result = visitor(tile);
    }
    return result.has_value();
  };
  const auto on_damage = [&](const Damage& damage) {
    if (result = snapshot_->unchanged(); !result) return false;
    if (damaged)
      damaged(damage);
    else
      result = tl::unexpected(static_cast<const Error&>(damage));
    return result.has_value();
  };
  RecordWalk(*snapshot_, from, to).run(visit_record, on_damage);
  if (result) result = snapshot_->unchanged();
  return result;
}

Result<TileStatistics> TileStore::statistics(const TileRange& keys) const {
  Result<void> result;
  TileStatistics sum;
  const auto count = [&](const Record& record) {
    ++sum.records;
    for (Record::Walk walk(record); walk.next();) {
      sum.stored += walk.tile().state == TileState::stored ? 1 : 0;
      sum.empty += walk.tile().state == TileState::empty ? 1 : 0;
      sum.same += walk.tile().state == TileState::same ? 1 : 0;
      sum.payload_bytes += walk.tile().payload.size();
    }
    return true;
  };
  const auto stop = [&](const Damage& damage) {
    result = tl::unexpected(static_cast<const Error&>(damage));
    return false;
  };
  RecordWalk(*snapshot_, keys.begin, keys.end).run(count, stop);
  SLF_TRY(snapshot_->unchanged());
  SLF_TRY(std::move(result));
  return sum;
}

Result<std::vector<TileRange>> TileStore::covered(const TileRange& keys) const {
  std::vector<TileRange> ranges;
  const auto add = [&](TileKey first, TileKey last) {
    const TileKey begin = std::max(first, keys.begin), end = std::min(after(last), keys.end);
    if (begin >= end) return true;
    if (ranges.empty() || ranges.back().end < begin) ranges.push_back({begin, begin});
    ranges.back().end = std::max(ranges.back().end, end);
    return true;
  };
  RecordWalk(*snapshot_, keys.begin, keys.end)
      .run([&](const Record& record) { return add(record.first(), record.last()); },
           [&](const Damage& damage) { return add(damage.first, damage.last); });
  SLF_TRY(snapshot_->unchanged());
  return ranges;
}

void TileStore::check_structure(std::vector<Error>& findings) const {
  internal::check_pages(snapshot_->pages(), internal::CheckScope::everything, findings);
  if (auto same = snapshot_->unchanged(); !same) findings.push_back(std::move(same.error()));
}

}  // namespace slf::storage
