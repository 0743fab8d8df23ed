// TileWriter: creates containers and appends tiles to them (LMDB does the writing).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "base/bytes.h"
#include "base/file.h"
#include "base/reporter.h"
#include "slf/error.h"
#include "storage/tile_store.h"

namespace slf::storage {

/// The only writer of a container. Appends tiles in key order. Once commit() has
/// returned, the data survives a crash of the process or the machine. Readers see whole commits
/// only. A writer makes no other file beside the container. Thread-safety: none; one thread.
class TileWriter {
 public:
  /// Creates the container `path` with its blobs, and commits. usage: the file exists. Other errors
  /// call it `name`, or `path` if that is empty.
  [[nodiscard]] static Result<TileWriter> create(
      const std::string& path, std::span<const std::pair<std::string, Bytes>> blobs,
      std::string name = {});

  /// Opens an existing container to append. Checks its structure first (bad_file).
  /// busy: another writer has it open. failed: a reader holds a snapshot older than the last
  /// commit, whose pages this writer might overwrite. io: no write permission.
  [[nodiscard]] static Result<TileWriter> resume(const std::string& path);

  TileWriter(TileWriter&&) noexcept;
  TileWriter& operator=(TileWriter&&) noexcept;
  /// Discards what was not committed; call close() to keep it.
  ~TileWriter();

  /// The number of the last commit; equal to that of a TileStore that shows the same state.
  [[nodiscard]] std::uint64_t transaction() const;

  /// The last committed key, if any. A build resumes after it.
  [[nodiscard]] std::optional<TileKey> last() const;

  /// About how many bytes of complete or changed records the next commit() will write. They stay in
  /// memory until then, so commit every hundred megabytes or so.
  [[nodiscard]] std::uint64_t pending_bytes() const;

  /// Appends a tile; an empty payload means an empty tile or, if `back` is not 0, one that is the
  /// same as the one that is stored `back` states before. usage: the key is not above all earlier
  /// keys, the level is above 254, the payload is larger than 1 GiB, or there is no such state.
  [[nodiscard]] Result<void> append(TileKey key, Bytes payload, std::uint64_t back = 0);

  /// Appends a tile that is missing, so that replace() can fill it. Errors as append().
  [[nodiscard]] Result<void> append_missing(TileKey key);

  /// Replaces a damaged or missing tile of a committed record, in the next commit. A commit writes
  /// each record once, however many of its tiles are replaced; so replace many tiles in key order.
  /// If the record's table itself is damaged, its other tiles become missing. `payload`, `back`: as
  /// for append().
  /// usage: in the tile's level, no committed record includes the tile or begins after it.
  /// bad_file: the tree or the record's pages are damaged.
  [[nodiscard]] Result<void> replace(TileKey key, ByteSpan payload, std::uint64_t back = 0);

  /// Makes a tile missing, as replace() replaces it.
  [[nodiscard]] Result<void> drop(TileKey key);

  /// From now on commit() does not wait for the disk, so a crash of the machine can damage the
  /// file. close() and publish() still wait. This is for files that are useless until complete.
  void defer_sync();

  /// Sets a named blob, in the next commit.
  [[nodiscard]] Result<void> set_blob(std::string_view name, ByteSpan value);

  /// Ends the incomplete records, so that the next commit() includes every tile. The records of a
  /// container depend on where this is called. So every build of it must call this at the same
  /// places, such as the ends of levels.
  void end_records();

  /// Makes all complete records durable. A commit does not end a record: the tiles of the last,
  /// incomplete one stay in memory until it is complete or close() is called.
  /// io: the disk is full or a write failed; the file then holds the previous commit, and commit()
  /// may be called again. failed: the file was removed, renamed or replaced meanwhile.
  [[nodiscard]] Result<void> commit();

  /// Called with the path of a closed file that is still locked.
  using Finish = std::function<Result<void>(const std::string& path)>;

  /// Completes the last records, commits, syncs and closes. Then calls `finish`, if given, and
  /// unlocks the file. Errors as commit(), and those of `finish`.
  [[nodiscard]] Result<void> close(const Finish& finish = {});

  /// Closes as close() does, and durably renames the file to `to`, in the same folder. The file
  /// stays locked until then. usage: `to` exists and must be kept; the file is then closed under
  /// its old name.
  [[nodiscard]] Result<void> publish(const std::string& to, Existing existing,
                                     const Finish& finish = {});

 private:
  struct State;
  explicit TileWriter(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// A section of an index that storage itself does not use.
struct IndexExtra {
  std::uint32_t id = 0;  ///< 256 <= id < 2^32 - 1
  Bytes bytes;
};

/// Writes an index after the last page of a complete, closed container, and syncs
/// (doc/format/optional.md, "Index"). It replaces whatever follows that page. The same pages and
/// extras give the same index. Sections of more than 1 MiB are left out. Errors as
/// TileStore::open(), or io. cancelled: stopped by `go_on`; nothing was written.
[[nodiscard]] Result<void> write_index(const std::string& path,
                                       std::span<const IndexExtra> extras = {},
                                       const GoOn& go_on = {});

/// busy: a process has the container open to write. Others: whether one has cannot be told.
[[nodiscard]] Result<void> check_no_writer(const std::string& path);

}  // namespace slf::storage
