#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <functional>
#include <map>
#include <utility>

#include "base/file.h"
#include "base/guarded.h"
#include "base/try.h"
#include "storage/internal/environment.h"
#include "storage/internal/locked_file.h"
#include "storage/internal/record_builder.h"
#include "storage/internal/snapshot.h"
#include "storage/internal/structure.h"
#include "storage/tile_store.h"
#include "storage/tile_writer.h"

namespace slf::storage {

using internal::CompleteRecord;
using internal::Container;
using internal::Environment;
using internal::LockedFile;
using internal::Put;
using internal::RecordBuilder;
using internal::RecordKey;
using internal::Snapshot;

namespace {

using SealedBlobs = std::map<std::string, Bytes, std::less<>>;

Result<void> check_blob_name(std::string_view name) {
  if (!name.empty() && name.size() <= internal::kMaxBlobName && name != internal::kContainer)
    return {};
  return fail(ErrorCode::usage, "blob name '", name, "': expected 1 to ", internal::kMaxBlobName,
              " characters, and not '", internal::kContainer, "'");
}

// Writes one commit: replaced records, new records, blobs, and the container's own blob.
Result<void> write(Environment& environment, std::span<const CompleteRecord> edited,
                   std::span<const CompleteRecord> appended, const SealedBlobs& blobs,
                   Container container) {
  std::vector<RecordKey> keys;
  keys.reserve(edited.size() + appended.size());
  std::vector<Put> puts;
  const auto add = [&](const CompleteRecord& record, bool append) {
    keys.push_back(internal::encode_key(record.last));
    puts.push_back({std::string(internal::kTiles), keys.back(), record.bytes(),
                    [&record](std::span<std::byte> to) { record.write(to); }, append});
  };
  for (const CompleteRecord& record : edited) add(record, false);
  for (const CompleteRecord& record : appended) add(record, true);
  const auto add_blob = [&](std::string_view name, const Bytes& sealed) {
    puts.push_back({std::string(internal::kManifest), bytes_of(name), sealed.size(),
                    [&sealed](std::span<std::byte> to) { std::ranges::copy(sealed, to.begin()); },
                    false});
  };
  for (const auto& [name, sealed] : blobs) add_blob(name, sealed);
  container.transaction = environment.transaction() + 1;
  const Bytes own =
      internal::seal_blob(internal::kContainer, internal::encode_container(container));
  add_blob(internal::kContainer, own);
  return environment.put(puts);
}

// A put without a key only creates the tree.
Result<void> write_new(Environment& environment, const SealedBlobs& blobs) {
  SLF_TRY(environment.put(std::vector<Put>{{std::string(internal::kTiles), {}, 0, {}, false}}));
  return write(environment, {}, {}, blobs, {});
}

// Checks that the tree ends with the record that the container names as its last. Only then may new
// records be appended to it.
Result<void> check_end(const Snapshot& snapshot) {
  auto last = SLF_TRY(snapshot.last_before({internal::kNoLevel, ~std::uint64_t{0}}));
  if (last == snapshot.container().last) return {};
  return bad_file(snapshot.path(), "does not end with its last record");
}

// A committed record, some of whose tiles are being replaced. The other tiles view the snapshot.
struct Edit {
  std::optional<TileKey> previous;
  TileKey first;
  std::vector<internal::Tile> tiles;
  std::map<TileKey, Bytes> payloads;  // of the tiles replaced

  // Extends the record to begin at `key`, if it begins later. Tiles between two records belong to
  // the second one.
  void begin_at(TileKey key) {
    if (first <= key) return;
    tiles.insert(tiles.begin(), first.index - key.index, internal::Tile());
    first = key;
  }
};

}  // namespace

struct TileWriter::State {
  std::string path;
  LockedFile file;                           // before the environment, which its lock must outlive
  std::unique_ptr<Environment> environment;  // null: closed
  Container container;                       // as committed
  RecordBuilder builder;
  std::vector<CompleteRecord> records;  // complete, not committed
  std::uint64_t record_bytes = 0;       // of `records`
  SealedBlobs blobs;                    // set, not committed
  std::map<TileKey, Edit> edits;        // by the last key of the record; not committed
  std::uint64_t edited_bytes = 0;       // of the records that `edits` make, approximately
  std::unique_ptr<Snapshot> base;       // the last commit, while there are edits

  // Opens LMDB on a locked, checked file.
  [[nodiscard]] Result<void> attach() {
    environment = SLF_TRY(Environment::open(path, file.descriptor()));
    builder = RecordBuilder(container.last);
    return {};
  }

  [[nodiscard]] std::string place(TileKey key) const { return path + ": tile " + name(key); }

  // The state of a tile with such a payload. usage: no tile can have it.
  [[nodiscard]] Result<TileState> state_with(TileKey key, ByteSpan payload,
                                             std::uint64_t back) const {
    if (back > key.state || (back > 0 && !payload.empty()))
      return misuse(place(key), "the same as ", back, " states before");
    return back > 0 ? TileState::same : payload.empty() ? TileState::empty : TileState::stored;
  }
  [[nodiscard]] Result<void> check_limits(TileKey key, ByteSpan payload) const {
    if (key.level != internal::kNoLevel && payload.size() <= internal::kMaxPayload) return {};
    return misuse(place(key), "levels go up to 254, payloads up to ", internal::kMaxPayload,
                  " bytes; this one has ", payload.size());
  }

  // Pages freed by earlier commits may be reused if no reader has a snapshot older than the last.
  [[nodiscard]] Result<void> before_commit() {
    if (file.pinned_before(environment->transaction())) return {};
    return environment->allow_reuse();
  }

  // failed: `path` no longer names the file that was written.
  [[nodiscard]] Result<void> check_place() const {
    if (is_same_file(file.descriptor(), path)) return {};
    return fail(ErrorCode::failed, path,
                ": was removed, renamed or replaced while it was being written; what was written "
                "is not there");
  }

  [[nodiscard]] Result<void> commit() {
    if (!environment) return misuse(path, "was closed");
    if (!records.empty() || !blobs.empty() || !edits.empty()) SLF_TRY(commit_pending());
    SLF_TRY(environment->extend());
    return check_place();
  }

  [[nodiscard]] Result<void> commit_pending() {
    SLF_TRY(before_commit());
    Container committed = container;
    committed.records += records.size();
    if (!records.empty()) committed.last = records.back().last;
    std::vector<CompleteRecord> edited;
    for (const auto& [last, edit] : edits) {
      Bytes head = internal::encode_record_head(edit.previous, edit.first, edit.tiles);
      auto& payloads = edited.emplace_back(CompleteRecord{last, std::move(head), {}}).payloads;
      for (const internal::Tile& tile : edit.tiles)
        if (tile.state == TileState::stored) payloads.emplace_back(tile.payload);
    }
    const std::uint64_t before = environment->transaction();
    auto written = write(*environment, edited, records, blobs, committed);
    if (environment->transaction() == before) return written;
    container = committed;
    records.clear();
    record_bytes = 0;
    blobs.clear();
    edits.clear();
    edited_bytes = 0;
    base.reset();
    return written;
  }

  [[nodiscard]] tl::unexpected<Error> no_record(TileKey key) const {
    return misuse(path, "no record holds tile ", name(key));
  }

  [[nodiscard]] Result<Edit*> edit(TileKey key);
  [[nodiscard]] Result<void> append(internal::NewTile tile);
  [[nodiscard]] Result<void> replace(TileKey key, TileState state, ByteSpan payload,
                                     std::uint64_t back);
};

TileWriter::TileWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
TileWriter::TileWriter(TileWriter&&) noexcept = default;
TileWriter& TileWriter::operator=(TileWriter&&) noexcept = default;
TileWriter::~TileWriter() = default;

Result<TileWriter> TileWriter::create(const std::string& path,
                                      std::span<const std::pair<std::string, Bytes>> blobs,
                                      std::string name) {
  if (name.empty()) name = path;
  SealedBlobs sealed;
  for (const auto& [blob, bytes] : blobs) {
    SLF_TRY(check_blob_name(blob));
    sealed[blob] = internal::seal_blob(blob, bytes);
  }
  auto file = SLF_TRY(NewFile::create(path, name));  // a crash leaves no partial container
  auto state = std::make_unique<State>();
  state->path = path;
  state->file = LockedFile(Descriptor(fcntl(file.descriptor(), F_DUPFD_CLOEXEC, 0)));
  SLF_TRY(state->file.lock_writer(name));
  bool published = false;
  const auto finish = [&]() -> Result<void> {
    {
      auto environment = SLF_TRY(Environment::open(name, file.descriptor()));
      SLF_TRY(write_new(*environment, sealed));
      SLF_TRY(environment->extend());
    }
    SLF_TRY(file.publish(Existing::keep));
    published = true;
    return state->attach();
  };
  if (auto finished = guarded(finish); !finished) {
    if (published) unlink(path.c_str());  // it is new, and locked
    return tl::unexpected(std::move(finished.error()));
  }
  return TileWriter(std::move(state));
}

Result<TileWriter> TileWriter::resume(const std::string& path) {
  auto state = std::make_unique<State>();
  state->path = path;
  auto file = SLF_TRY(LockedFile::open(path, LockedFile::Access::write));
  state->file = std::move(file);
  SLF_TRY(state->file.lock_writer(path));
  SLF_TRY(state->check_place());
  auto snapshot = SLF_TRY(Snapshot::open_locked(path, state->file));
  std::vector<Error> findings;
  internal::check_pages(snapshot->pages(), internal::CheckScope::trees, findings);
  if (!findings.empty()) return tl::unexpected(std::move(findings.front()));
  SLF_TRY(check_end(*snapshot));
  SLF_TRY(snapshot->unchanged());
  const std::uint64_t transaction = snapshot->meta().transaction;
  // LMDB may reuse all pages that this transaction does not need.
  if (state->file.pinned_before(transaction))
    return fail(ErrorCode::failed, path,
                ": another program still reads an older state of it; close or reload it there, "
                "then try again");
  state->container = snapshot->container();
  SLF_TRY(state->attach());
  if (state->environment->transaction() != transaction)
    return bad_file(path, "LMDB sees transaction ", state->environment->transaction(),
                    ", expected ", transaction);
  return TileWriter(std::move(state));
}

std::uint64_t TileWriter::transaction() const {
  return state_->environment ? state_->environment->transaction() : 0;
}

std::optional<TileKey> TileWriter::last() const { return state_->container.last; }

std::uint64_t TileWriter::pending_bytes() const {
  return state_->record_bytes + state_->edited_bytes;
}

Result<void> TileWriter::append(TileKey key, Bytes payload, std::uint64_t back) {
  const TileState state = SLF_TRY(state_->state_with(key, payload, back));
  payload.shrink_to_fit();  // codecs make room for the worst case, and many payloads wait
  return state_->append({key, state, std::move(payload), back});
}

Result<void> TileWriter::append_missing(TileKey key) {
  return state_->append({key, TileState::missing});
}

Result<void> TileWriter::State::append(internal::NewTile tile) {
  const TileKey key = tile.key;
  const auto last = builder.last();
  if (last && key <= *last)
    return misuse(place(key), "tiles are appended in key order; ", "the last one was ",
                  name(*last));
  SLF_TRY(check_limits(key, tile.payload));
  const std::size_t before = records.size();
  builder.append(std::move(tile), records);
  for (std::size_t k = before; k < records.size(); ++k) record_bytes += records[k].bytes();
  return {};
}

Result<void> TileWriter::set_blob(std::string_view name, ByteSpan value) {
  SLF_TRY(check_blob_name(name));
  state_->blobs[std::string(name)] = internal::seal_blob(name, value);
  return {};
}

Result<void> TileWriter::commit() { return state_->commit(); }

void TileWriter::defer_sync() {
  if (state_->environment) state_->environment->defer_sync();
}

void TileWriter::end_records() {
  state_->builder.finish(state_->records);
  state_->record_bytes = 0;
  for (const CompleteRecord& record : state_->records) state_->record_bytes += record.bytes();
}

Result<void> TileWriter::close(const Finish& finish) {
  end_records();
  SLF_TRY(state_->commit());
  SLF_TRY(state_->environment->sync());
  state_->environment.reset();
  if (finish) SLF_TRY(finish(state_->path));
  state_->file = {};  // only now, so no other writer can open the file before
  return {};
}

Result<void> TileWriter::publish(const std::string& to, Existing existing, const Finish& finish) {
  end_records();
  SLF_TRY(state_->commit());
  state_->environment.reset();
  if (finish) SLF_TRY(finish(state_->path));
  auto published = publish_file(state_->path, to, existing);
  state_->file = {};  // only now, so no other writer can open the file before it has its name
  return published;
}

Result<void> TileWriter::replace(TileKey key, ByteSpan payload, std::uint64_t back) {
  const TileState state = SLF_TRY(state_->state_with(key, payload, back));
  return state_->replace(key, state, payload, back);
}

Result<void> TileWriter::drop(TileKey key) {
  return state_->replace(key, TileState::missing, {}, 0);
}

Result<void> TileWriter::State::replace(TileKey key, TileState state, ByteSpan payload,
                                        std::uint64_t back) {
  if (!environment) return misuse(path, "was closed");
  SLF_TRY(check_limits(key, payload));
  auto edited = SLF_TRY(edit(key));
  Bytes& copy = edited->payloads[key];
  copy.assign(payload.begin(), payload.end());
  edited_bytes += payload.size();
  internal::Tile& tile = edited->tiles[key.index - edited->first.index];
  tile = {state, copy, 0, 0, 0, back};
  if (state == TileState::stored) tile.checksum = payload_checksum(key, copy);
  return {};
}

// Returns the edit of the record that holds a tile, and begins one if there is none. If the
// record's table is damaged, all its tiles become missing.
Result<Edit*> TileWriter::State::edit(TileKey key) {
  if (const auto known = edits.lower_bound(key); known != edits.end() && known->second.first <= key)
    return &known->second;
  if (!base) {
    base = SLF_TRY(Snapshot::open_locked(path, file));
  }
  internal::Cursor cursor(base->pages(), base->tiles());
  auto at = SLF_TRY(cursor.seek(internal::encode_key(key)));
  const auto last = at ? internal::decode_key(cursor.key()) : std::nullopt;
  if (!last || last->level != key.level || last->state != key.state) return no_record(key);
  // LMDB will free the old value's pages, so check them first.
  const auto old = SLF_TRY(cursor.value());
  auto before = SLF_TRY(base->last_before(*last));

  Edit edit{before, *last, {}, {}};
  if (auto record = base->record(cursor)) {
    edit.first = record->first();
    for (internal::Record::Walk walk(*record); walk.next();) edit.tiles.push_back(walk.tile());
  } else {
    SLF_TRY(base->unchanged());        // else the disk may be what is damaged
    std::uint64_t room = last->index;  // no record has tiles of two states
    if (before && before->level == last->level && before->state == last->state)
      room = last->index - before->index - 1;
    edit.first.index -= std::min(room, internal::kMaxTiles - 1);
    edit.tiles.resize(last->index - edit.first.index + 1);
  }
  if (last->index - key.index >= internal::kMaxTiles) return no_record(key);
  const auto [at_record, begun] = edits.try_emplace(*last, std::move(edit));
  if (begun) edited_bytes += old.size();
  at_record->second.begin_at(key);
  return &at_record->second;
}

Result<void> check_no_writer(const std::string& path) {
  const auto file = LockedFile::open(path, LockedFile::Access::read);
  if (!file && file.error().code != ErrorCode::not_found) return tl::unexpected(file.error());
  if (!file || !file->has_writer()) return {};
  return fail(ErrorCode::busy, path, ": another process is writing it");
}

}  // namespace slf::storage
