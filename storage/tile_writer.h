// TileWriter: creates containers and appends tiles to them (LMDB does the writing).
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/tile_store.h"

namespace slf::storage {

/// The only writer of a container. Appends tiles in key order per layer; what commit() returned
/// for survives a crash of the process or machine; a reader sees whole commits only.
/// LMDB's lock file, `path`-lock, lies beside the container while a writer is open; whoever comes
/// after a killed writer removes it.
/// Thread-safety: none; one thread.
class TileWriter {
 public:
  /// Creates `path` (refuses an existing file: usage) with its layers and blobs, committed.
  [[nodiscard]] static Result<TileWriter> create(
      const std::string& path, std::span<const std::string> layers,
      std::span<const std::pair<std::string, Bytes>> blobs);

  /// Opens an existing container to append. Its structure is checked first (bad_file).
  /// failed: another writer has it open, or a reader still holds a snapshot older than the last
  /// commit, whose pages this writer might overwrite. io: no write permission.
  [[nodiscard]] static Result<TileWriter> resume(const std::string& path);

  TileWriter(TileWriter&&) noexcept;
  TileWriter& operator=(TileWriter&&) noexcept;
  /// Without close(), drops what was not committed.
  ~TileWriter();

  /// The last key of a layer that is committed, if any. Building resumes after it.
  [[nodiscard]] Result<std::optional<TileKey>> last(LayerId layer) const;

  /// Bytes of records, full or changed, that the next commit() will write, about. They are in
  /// memory until then, so commit every hundred megabytes or so.
  [[nodiscard]] std::uint64_t pending_bytes() const;

  /// Adds a tile; an empty payload records an empty tile.
  /// usage: key not above every key appended to or committed in this layer, level above 254, or a
  /// payload above 1 GiB.
  [[nodiscard]] Result<void> append(LayerId layer, TileKey key, ByteSpan payload);

  /// Replaces one tile within a committed record (a damaged or missing one), in the next commit. A
  /// record is written once however many of its tiles are replaced, so go in key order where there
  /// are many. Where the record's table itself is damaged, its other tiles become missing.
  /// usage: no committed record spans the tile. bad_file: the tree or the record's pages are
  /// damaged.
  [[nodiscard]] Result<void> replace(LayerId layer, TileKey key, TileState state, ByteSpan payload);

  /// Sets a named blob, in the next commit.
  [[nodiscard]] Result<void> set_blob(std::string_view name, ByteSpan value);

  /// Makes every full record durable. Records are cut at the same keys whatever the commits, so
  /// tiles of the record still being filled are kept in memory until it is full (or close()).
  /// io: disk full or a write error; the file then holds the previous commit, and the message says
  /// what to do.
  [[nodiscard]] Result<void> commit();

  /// Writes the last, partly filled records, commits, syncs and closes.
  [[nodiscard]] Result<void> close();

 private:
  struct State;
  explicit TileWriter(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace slf::storage
