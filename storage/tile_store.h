// The container of a field: layers of tiles in key order, and a few named blobs, in one LMDB file.
//
// Storage knows keys and bytes, nothing of spheres or codecs. Tiles are grouped into records of
// 64 KiB and more, each with a table and a checksum per tile (FORMAT.md). Reads come straight from
// the memory map; the bytes of the file are untrusted, so every page is checked before it is
// walked and no input, truncated, flipped, hostile, or shrinking while mapped, can crash a reader.
//
// Use:
//   auto store = storage::TileStore::open("brain.slf");
//   storage::TileRef tile = store->find(0, {2, 4711}).value();
//   if (tile.state == storage::TileState::stored && store->check(tile)) use(tile.payload);
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"
#include "slf/tile_key.h"

namespace slf::storage {

using slf::TileKey;

/// A layer by its position in the list given at creation.
using LayerId = std::uint32_t;

enum class TileState : std::uint8_t {
  missing,  ///< never built, or dropped as damaged
  empty,    ///< built, and nothing is there
  stored,   ///< has a payload
};

/// Where a tile lies. `payload` views the map: valid as long as the TileStore, but only as
/// trustworthy as the last check().
struct TileRef {
  TileState state = TileState::missing;
  LayerId layer = 0;
  TileKey key;
  ByteSpan payload;
  std::uint64_t checksum = 0;
};

/// Half-open range of bytes of the file.
struct FileRange {
  std::uint64_t begin = 0;
  std::uint64_t end = 0;
};

/// What a layer holds at one level.
struct LevelStatistics {
  std::uint8_t level = 0;
  std::uint64_t records = 0;
  std::uint64_t stored = 0;         ///< tiles
  std::uint64_t empty = 0;          ///< tiles
  std::uint64_t payload_bytes = 0;  ///< sum of the payloads
  std::uint64_t record_bytes = 0;   ///< of the records, with tables and padding
};

/// Part of a layer that cannot be read, with the keys it should hold, both inclusive. Usually one
/// record: TileWriter::replace() of its `last` makes all its tiles missing, so that they can be
/// filled again. Where a page of the tree is lost there may be many records, and no way to tell.
struct Damage : Error {
  TileKey first;
  TileKey last;
};

/// A consistent, read-only snapshot of a container: what was committed when it was opened, however
/// much a writer adds meanwhile.
/// Thread-safety: all const members may be called from many threads at once.
class TileStore {
 public:
  /// io: missing, unreadable. bad_file: not a container, truncated, damaged meta pages.
  /// unsupported: made by LMDB of another version or page size.
  /// Needs read permission only, and leaves no lock file. A lock on the container itself holds the
  /// snapshot against a concurrent writer, in any process; file systems without locks hold nothing.
  /// Takes the same time however many tiles there are.
  ///
  /// The first open() installs a handler for SIGBUS: a file that shrinks while it is open makes
  /// the calls below return bad_file instead of ending the process. Faults in other memory go to
  /// the handler that was there before.
  [[nodiscard]] static Result<TileStore> open(const std::string& path);

  TileStore(TileStore&&) noexcept;
  TileStore& operator=(TileStore&&) noexcept;
  ~TileStore();

  [[nodiscard]] const std::string& path() const;
  [[nodiscard]] std::uint64_t file_bytes() const;
  [[nodiscard]] const std::vector<std::string>& layers() const;

  /// Whether the file has shrunk under the map and a page was missed. Payloads read since then may
  /// have been zeros; ask after using bytes that were check()ed earlier.
  [[nodiscard]] bool changed() const;

  /// A named blob, checked against its checksum. bad_file when absent or damaged.
  [[nodiscard]] Result<ByteSpan> blob(std::string_view name) const;

  /// Finds a tile without touching its payload: a B-tree descent and the record's table.
  /// bad_file: a page on the way, or the record's table, is damaged.
  [[nodiscard]] Result<TileRef> find(LayerId layer, TileKey key) const;

  /// Finds many tiles of a layer, given in any order; the results are in the order of `keys` and
  /// as find() gives them. (Of a damaged file it may find tiles that find() cannot reach.) Where
  /// the file is not in memory, much faster than one after the other: the pages that the search
  /// needs next are fetched together. advise() then fetches the payloads.
  [[nodiscard]] std::vector<Result<TileRef>> find_all(LayerId layer,
                                                      std::span<const TileKey> keys) const;

  /// Verifies a stored tile's checksum (touches the payload). bad_file names layer and key.
  [[nodiscard]] Result<void> check(const TileRef& tile) const;

  /// Copies a stored tile's payload out of the file, and verifies its checksum. Leaves the map
  /// alone: no page of the payload becomes part of it. Errors as check(), or io.
  /// REQUIRES: `to` is as long as the payload.
  [[nodiscard]] Result<void> copy(const TileRef& tile, std::span<std::byte> to) const;

  /// Asks the kernel to read the tiles' pages soon; neighbouring ranges are merged.
  void advise(std::span<const TileRef> tiles) const;

  /// Tells the kernel that the tiles' pages are no longer needed by this process (MADV_DONTNEED
  /// on the shared read-only map: safe, the file is unchanged).
  void release(std::span<const TileRef> tiles) const;
  /// The same of the whole map. Payloads in use stay valid: they are read from the file again.
  void release_all() const;

  /// The part of the file a payload lies in, for counting pages.
  [[nodiscard]] FileRange range(const TileRef& tile) const;

  /// The pages of the file that finding and reading some tiles of a layer fetches, ascending: of
  /// the tree, of the records' tables and of the payloads. Touches no payload. Errors as find().
  [[nodiscard]] Result<std::vector<std::uint64_t>> pages(LayerId layer,
                                                         std::span<const TileKey> keys) const;

  /// The base of the map, for mincore and smaps cross-checks; file_bytes() long.
  [[nodiscard]] const std::byte* map() const;

  /// Visits the tiles of a layer with key in [from, to) in key order (missing ones not at all).
  /// A damaged record goes to `damaged`, once, with the keys it should hold, when given; without it
  /// iteration stops with that error. The visitor's error stops iteration and is returned.
  using Visitor = std::function<Result<void>(const TileRef&)>;
  using DamageVisitor = std::function<void(const Damage&)>;
  [[nodiscard]] Result<void> visit(LayerId layer, TileKey from, TileKey to, const Visitor& visitor,
                                   const DamageVisitor& damaged = {}) const;

  /// Counts the tiles of a layer, one entry per level that has records, from the records' tables
  /// alone: no payload is touched. bad_file: a damaged page or record.
  [[nodiscard]] Result<std::vector<LevelStatistics>> statistics(LayerId layer) const;

  /// Walks every page of the file: each is reachable once, within bounds, in order, or on the free
  /// list. Appends one error per finding.
  void check_structure(std::vector<Error>& findings) const;

 private:
  struct State;
  explicit TileStore(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace slf::storage
