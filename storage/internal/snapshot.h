// Snapshot: an open container at one transaction: file, lock, map and trees.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/internal/container.h"
#include "storage/internal/cursor.h"
#include "storage/internal/locked_file.h"
#include "storage/internal/mapped_file.h"
#include "storage/internal/pages.h"
#include "storage/internal/record.h"

namespace slf::storage::internal {

/// Not movable, because its pages refer to it. Thread-safety: const members from any thread.
class Snapshot {
 public:
  /// Opens the current snapshot and pins it against writers. The time does not depend on the number
  /// of tiles. Errors as of TileStore::open().
  [[nodiscard]] static Result<std::unique_ptr<Snapshot>> open(const std::string& path);

  /// Opens the current snapshot for the writer, which holds the container's lock.
  [[nodiscard]] static Result<std::unique_ptr<Snapshot>> open_locked(const std::string& path,
                                                                     const LockedFile& file);

  Snapshot(const Snapshot&) = delete;
  Snapshot& operator=(const Snapshot&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] const Pages& pages() const { return pages_; }
  [[nodiscard]] const Meta& meta() const { return pages_.meta(); }
  [[nodiscard]] ByteSpan bytes() const { return map_.bytes(); }
  [[nodiscard]] const std::vector<LayerInfo>& layers() const { return layers_; }
  [[nodiscard]] const Tree& manifest() const { return manifest_; }
  [[nodiscard]] const Tree& tree(LayerId layer) const { return trees_[layer]; }

  /// bad_file if the file has shrunk under the map: bytes read before may have been zeros.
  [[nodiscard]] Result<void> unchanged() const;

  /// Reads a part of bytes() from the file, bypassing the map. io: the read failed. bad_file: the
  /// file has shrunk. REQUIRES: opened with open(); `to` is as long as `part`.
  [[nodiscard]] Result<void> read(ByteSpan part, std::span<std::byte> to) const;

  /// A blob that matches its checksum. bad_file: it is missing or damaged.
  [[nodiscard]] Result<ByteSpan> blob(std::string_view name) const;

  /// The checked record at a cursor's entry. bad_file: it is damaged or belongs elsewhere.
  [[nodiscard]] Result<Record> record(LayerId layer, const Cursor& at) const;

  /// The key of the last record before `key`, if any. bad_file: a page on the path is damaged.
  [[nodiscard]] Result<std::optional<TileKey>> last_before(LayerId layer, TileKey key) const;

  /// The record that holds a key; nothing if certainly no record does.
  /// bad_file: a page on the path or the record is damaged, or a record is lost.
  [[nodiscard]] Result<std::optional<Record>> find(LayerId layer, TileKey key) const;

 private:
  [[nodiscard]] Result<void> shrunk() const;
  explicit Snapshot(std::string path) : path_(std::move(path)) {}

  [[nodiscard]] Result<Meta> pin_current();
  [[nodiscard]] Result<void> load(const Meta& meta, const LockedFile& file);
  [[nodiscard]] Result<Tree> named_tree(std::string_view name) const;

  std::string path_;
  LockedFile file_;
  MappedFile map_;
  Pages pages_;
  Tree manifest_;
  std::vector<LayerInfo> layers_;
  std::vector<Tree> trees_;
};

}  // namespace slf::storage::internal
