// Trees: the trees, blobs and records of a snapshot, mapped or from a ByteSource.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/internal/container.h"
#include "storage/internal/cursor.h"
#include "storage/internal/pages.h"
#include "storage/internal/record.h"

namespace slf::storage::internal {

/// An upper bound for the number of tiles in the record of entry `index`. Reads the leaf only.
/// REQUIRES: `node` is that entry.
[[nodiscard]] std::uint64_t max_tiles_in_record(const TreePage& leaf, std::uint32_t index,
                                                const Node& node);

/// The bytes that header and table of a record with `span` tiles usually need.
[[nodiscard]] std::uint64_t usual_head_bytes(std::uint64_t span);

/// Not movable, because its pages refer to it. Thread-safety: const members from any thread.
class Trees {
 public:
  explicit Trees(std::string path) : path_(std::move(path)) {}
  Trees(const Trees&) = delete;
  Trees& operator=(const Trees&) = delete;
  virtual ~Trees() = default;

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] const Pages& pages() const { return pages_; }
  [[nodiscard]] const Meta& meta() const { return pages_.meta(); }
  [[nodiscard]] const Container& container() const { return container_; }
  [[nodiscard]] const Tree& manifest() const { return manifest_; }
  [[nodiscard]] const Tree& tiles() const { return tiles_; }

  /// Finds the trees and reads the container's own blob. bad_file: the container is damaged.
  /// May be called again after an error. REQUIRES: `pages` was made with &path().
  [[nodiscard]] Result<void> load(const Pages& pages);

  /// bad_file, io: the file has changed or cannot be read, so bytes read before may be wrong.
  [[nodiscard]] virtual Result<void> unchanged() const { return {}; }

  /// Whether there is a blob of this name. bad_file: a page on the way to it is damaged.
  [[nodiscard]] Result<bool> has_blob(std::string_view name) const;
  /// A blob that matches its checksum. bad_file: it is missing or damaged.
  [[nodiscard]] Result<ByteSpan> blob(std::string_view name) const;

  /// The checked record at a cursor's entry. bad_file: it is damaged or belongs elsewhere.
  [[nodiscard]] Result<Record> record(const Cursor& at) const;

  /// The key of the last record before `key`, if any. bad_file: a page on the path is damaged.
  [[nodiscard]] Result<std::optional<TileKey>> last_before(TileKey key) const;

  /// The record that holds a key, or none if no record does. Sets `offset`, if not null, to the
  /// record's start in the file. bad_file: a page on the path or the record is damaged, or a record
  /// is lost, so the answer is unknown.
  [[nodiscard]] Result<std::optional<Record>> find(TileKey key,
                                                   std::uint64_t* offset = nullptr) const;

 private:
  [[nodiscard]] Result<Tree> named_tree(std::string_view name) const;
  [[nodiscard]] Result<Record> parse(const Cursor& at) const;

  std::string path_;
  Pages pages_;
  Tree manifest_;
  Tree tiles_;
  Container container_;
};

}  // namespace slf::storage::internal
