#include "storage/internal/snapshot.h"

#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <thread>

namespace slf::storage::internal {
namespace {

constexpr int kAttempts = 100;

ByteSpan bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

}  // namespace

Result<std::unique_ptr<Snapshot>> Snapshot::open(const std::string& path) {
  std::unique_ptr<Snapshot> snapshot(new Snapshot(path));
  auto file = LockedFile::open(path, LockedFile::Access::read);
  if (!file) return tl::unexpected(std::move(file.error()));
  snapshot->file_ = std::move(*file);
  auto meta = snapshot->pin_current();
  if (!meta) return tl::unexpected(std::move(meta.error()));
  if (auto loaded = snapshot->load(*meta, snapshot->file_); !loaded)
    return tl::unexpected(std::move(loaded.error()));
  return snapshot;
}

Result<std::unique_ptr<Snapshot>> Snapshot::open_locked(const std::string& path,
                                                        const LockedFile& file) {
  std::unique_ptr<Snapshot> snapshot(new Snapshot(path));
  auto meta = read_metas(file.descriptor(), path);
  if (!meta) return tl::unexpected(std::move(meta.error()));
  if (auto loaded = snapshot->load(*meta, file); !loaded)
    return tl::unexpected(std::move(loaded.error()));
  return snapshot;
}

// A pin is valid if its transaction is still the current one after the lock was taken: no writer
// can have reused pages of the current snapshot, and a later commit sees the lock.
Result<Meta> Snapshot::pin_current() {
  Result<Meta> meta = read_metas(file_.descriptor(), path_);
  for (int i = 0; i < kAttempts; ++i) {
    if (!meta) {
      // A writer may have been in the middle of writing a meta page.
      std::this_thread::yield();
      meta = read_metas(file_.descriptor(), path_);
      if (!meta) return meta;
    }
    const std::uint64_t transaction = meta->transaction;
    file_.pin(transaction);
    std::atomic_thread_fence(std::memory_order_seq_cst);
    meta = read_metas(file_.descriptor(), path_);
    if (meta && meta->transaction == transaction) return meta;
    file_.unpin(transaction);
  }
  return fail(ErrorCode::failed, path_, ": a writer commits faster than it can be opened");
}

Result<void> Snapshot::load(const Meta& meta, const LockedFile& file) {
  auto size = file.size(path_);
  if (!size) return tl::unexpected(std::move(size.error()));
  if (meta.last_page < 1 || meta.last_page >= *size / meta.page_size)
    return fail(ErrorCode::bad_file, path_, ": truncated: ", *size, " bytes, expected ",
                meta.last_page + 1, " pages of ", meta.page_size);
  auto map = MappedFile::map(file.descriptor(), static_cast<std::size_t>(*size), path_);
  if (!map) return tl::unexpected(std::move(map.error()));
  map_ = std::move(*map);
  pages_ = Pages(map_.bytes(), meta, &path_);

  auto manifest = named_tree(kManifest);
  if (!manifest) return tl::unexpected(std::move(manifest.error()));
  manifest_ = *manifest;
  auto sealed = blob(kContainer);
  if (!sealed) return tl::unexpected(std::move(sealed.error()));
  auto container = decode_container(*sealed);
  if (!container)
    return fail(container.error().code, path_, ": container: ", container.error().message);
  if (container->transaction != meta.transaction)
    return fail(ErrorCode::bad_file, path_, ": the meta page names transaction ", meta.transaction,
                ", the container ", container->transaction,
                ": damaged, or written to by another program");
  layers_ = std::move(container->layers);
  for (const LayerInfo& layer : layers_) {
    auto tree = named_tree(layer.name);
    if (!tree) return tl::unexpected(std::move(tree.error()));
    if (tree->entries != layer.records)
      return fail(ErrorCode::bad_file, path_, ": layer ", layer.name, " has ", tree->entries,
                  " records, expected ", layer.records);
    trees_.push_back(*tree);
  }
  return unchanged();
}

Result<Tree> Snapshot::named_tree(std::string_view name) const {
  Cursor cursor(pages_, meta().main);
  auto found = cursor.seek(bytes_of(name));
  if (!found) return tl::unexpected(std::move(found.error()));
  if (!*found || compare_keys(cursor.key(), bytes_of(name)) != 0)
    return fail(ErrorCode::bad_file, path_, ": not a field, or damaged: it has no tree '", name,
                "'");
  if (cursor.node().flags != kSubTree || cursor.node().data.size() != kTreeBytes)
    return fail(ErrorCode::bad_file, path_, ": the entry of tree '", name, "' is damaged");
  const Tree tree = Tree::parse(cursor.node().data.data());
  if (tree.flags != 0)
    return fail(ErrorCode::bad_file, path_, ": tree '", name, "' has flags ", tree.flags,
                ", expected none");
  return tree;
}

Result<void> Snapshot::unchanged() const {
  if (!map_.changed()) return {};
  return shrunk();
}

Result<void> Snapshot::shrunk() const {
  return fail(ErrorCode::bad_file, path_, ": changed while open: it has become shorter");
}

Result<void> Snapshot::read(ByteSpan part, std::span<std::byte> to) const {
  auto offset = static_cast<off_t>(part.data() - map_.bytes().data());
  while (!to.empty()) {
    const ssize_t got = pread(file_.descriptor(), to.data(), to.size(), offset);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return fail(ErrorCode::io, path_, ": cannot read: ", std::strerror(errno));
    if (got == 0) return shrunk();
    to = to.subspan(static_cast<std::size_t>(got));
    offset += got;
  }
  return {};
}

Result<ByteSpan> Snapshot::blob(std::string_view name) const {
  Cursor cursor(pages_, manifest_);
  auto found = cursor.seek(bytes_of(name));
  if (!found) return tl::unexpected(std::move(found.error()));
  if (!*found || compare_keys(cursor.key(), bytes_of(name)) != 0)
    return fail(ErrorCode::bad_file, path_, ": has no blob '", name, "'");
  auto sealed = cursor.value();
  if (!sealed) return sealed;
  auto bytes = open_blob(name, *sealed);
  if (auto same = unchanged(); !same) return tl::unexpected(std::move(same.error()));
  if (!bytes)
    return fail(bytes.error().code, path_, ": blob '", name, "': ", bytes.error().message);
  return bytes;
}

Result<Record> Snapshot::record(LayerId layer, const Cursor& at) const {
  const auto key = decode_key(at.key());
  if (!key)
    return fail(ErrorCode::bad_file, path_, ": layer ", layers_[layer].name, ": a record's key of ",
                at.key().size(), " bytes, expected 9");
  auto value = at.value();
  auto record = value ? Record::parse(*value) : tl::unexpected(std::move(value.error()));
  if (record && (record->layer() != layer || record->last() != *key))
    record = fail(ErrorCode::bad_file, "a record of layer ", record->layer(), " that ends at tile ",
                  int{record->last().level}, "/", record->last().index, " lies in its place");
  if (!record)
    return fail(record.error().code, path_, ": layer ", layers_[layer].name,
                ", record ending at tile ", int{key->level}, "/", key->index, ": ",
                record.error().message);
  return record;
}

Result<std::optional<TileKey>> Snapshot::last_before(LayerId layer, TileKey key) const {
  Cursor cursor(pages_, trees_[layer]);
  auto found = cursor.seek_before(encode_key(key));
  if (!found) return tl::unexpected(std::move(found.error()));
  if (!*found) return std::nullopt;
  const auto before = decode_key(cursor.key());
  if (!before || *before >= key)
    return fail(ErrorCode::bad_file, path_, ": layer ", layers_[layer].name,
                ": the records are out of order");
  return *before;
}

Result<std::optional<Record>> Snapshot::find(LayerId layer, TileKey key) const {
  const LayerInfo& info = layers_[layer];
  if (!info.last || key > *info.last) return std::nullopt;
  Cursor cursor(pages_, trees_[layer]);
  auto found = cursor.seek(encode_key(key));
  if (!found) return tl::unexpected(std::move(found.error()));
  auto held = *found ? record(layer, cursor)
                     : fail(ErrorCode::bad_file, path_, ": layer ", info.name,
                            " ends before its last tile");
  if (auto same = unchanged(); !same) return tl::unexpected(std::move(same.error()));
  if (!held) return tl::unexpected(std::move(held.error()));
  if (key > held->last() || (held->previous() && key <= *held->previous()))
    return fail(ErrorCode::bad_file, path_, ": layer ", info.name, ": the record of tile ",
                int{key.level}, "/", key.index, " is lost");
  if (key < held->first()) return std::nullopt;
  return *held;
}

}  // namespace slf::storage::internal
