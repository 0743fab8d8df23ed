// The container of a field: tiles in key order, and a few named blobs, in one LMDB file.
//
// Storage handles keys and bytes; it does not depend on spheres or codecs. Tiles are grouped into
// records of 64 KiB and more, each with a table and a checksum per tile (FORMAT.md). Payloads are
// read directly from the memory map. The file is untrusted: every page is checked before use, so no
// file can crash a reader, be it truncated, damaged, hostile, or shrinking while it is mapped.
//
// Use:
//   auto store = storage::TileStore::open("brain.slf");
//   storage::TileRef tile = store->find({2, 4711}).value();
//   if (tile.state == storage::TileState::stored && store->check(tile)) use(tile.payload);
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"
#include "slf/tile.h"

namespace slf::storage {

using slf::TileKey;
using slf::TileState;

class RangeSource;
namespace internal {
class Snapshot;
}

/// A tile's state and payload. `payload` views the map and is valid as long as the TileStore lives.
/// Its bytes are untrusted until check() has succeeded.
struct TileRef {
  TileState state = TileState::missing;
  TileKey key;
  ByteSpan payload{};
  std::uint64_t checksum = 0;
  TileKey source = key;  ///< the tile that has the payload, in an earlier state if it is the same
};

/// "LEVEL/INDEX", and its state unless that is the first.
[[nodiscard]] std::string name(TileKey key);

/// The checksum of a payload. It covers the key, so a payload in the wrong place does not match.
[[nodiscard]] std::uint64_t payload_checksum(TileKey key, ByteSpan payload);

/// A half-open range of bytes of the file.
struct FileRange {
  std::uint64_t begin = 0;
  std::uint64_t end = 0;
  [[nodiscard]] std::uint64_t size() const { return end - begin; }
};

/// The content of some keys.
struct TileStatistics {
  std::uint64_t records = 0;
  std::uint64_t stored = 0;         ///< tiles
  std::uint64_t empty = 0;          ///< tiles
  std::uint64_t same = 0;           ///< tiles
  std::uint64_t payload_bytes = 0;  ///< sum of the payloads
};

/// A part of the container that cannot be read, and the keys that it should hold, both inclusive.
/// Usually it is one record; then TileWriter::replace() of `last` makes all tiles of the record
/// missing, so that they can be built again. If a page of the tree is lost, it may be any number of
/// records.
struct Damage : Error {
  TileKey first;
  TileKey last;
};

/// A consistent, read-only snapshot of a container: the last commit before it was opened. Later
/// commits do not affect it. A handle: copies are cheap and share it.
/// Thread-safety: all const members may be called from many threads at once.
class TileStore {
 public:
  /// not_found: no file. io: it is unreadable. bad_file: it is no container, truncated, or its meta
  /// pages are damaged. unsupported: written by LMDB of another version or page size.
  /// Needs read permission only, and leaves no lock file. A lock on the container itself protects
  /// the snapshot from a concurrent writer in any process, except on file systems without locks.
  /// The time that this takes does not depend on the number of tiles.
  ///
  /// The first open() installs a handler for SIGBUS. If a file shrinks while it is open, the calls
  /// below return bad_file and the process goes on. Faults in other memory go to the previous
  /// handler.
  [[nodiscard]] static Result<TileStore> open(const std::string& path);

  /// Opens a remote container. Its bytes are fetched when they are needed, and stay in a temporary
  /// file, which map() maps. A payload is present after check() or fetch(). Any call that
  /// reads may fail with the errors of RangeSource::fetch(). Other errors as above.
  [[nodiscard]] static Result<TileStore> open(std::shared_ptr<RangeSource> source);

  [[nodiscard]] const std::string& path() const;
  [[nodiscard]] std::uint64_t file_bytes() const;

  /// The number of the commit that this snapshot shows.
  [[nodiscard]] std::uint64_t transaction() const;

  /// bad_file, io: the file has shrunk, or its disk failed, and an access hit a missing page.
  /// Payloads read since then may have been zeros: call this after using bytes that were checked
  /// earlier.
  [[nodiscard]] Result<void> unchanged() const;

  /// Whether there is a blob of this name. bad_file: a page on the way to it is damaged.
  [[nodiscard]] Result<bool> has_blob(std::string_view name) const;

  /// A named blob that matches its checksum. bad_file: it is missing or damaged.
  [[nodiscard]] Result<ByteSpan> blob(std::string_view name) const;

  /// Whether the bytes come from a RangeSource.
  [[nodiscard]] bool is_remote() const;

  /// The verified bytes of a section of a remote file's index that storage itself does not use;
  /// empty if there is none, or if the file is local.
  [[nodiscard]] Bytes section(std::uint32_t id) const;

  /// Finds a tile by a B-tree descent and the record's table. Does not touch the payload. A tile
  /// that is the same as one of an earlier state is found stored, with that `source`, or missing if
  /// that is not stored.
  /// bad_file: a page on the path, or the record's table, is damaged.
  [[nodiscard]] Result<TileRef> find(TileKey key) const;

  /// Finds many tiles, given in any order. The results are those of find(), in the order
  /// of `keys`. (In a damaged file it may find tiles that find() cannot reach.) When the file is
  /// not in memory this is much faster than many find()s, because it fetches the pages that the
  /// search needs in batches. advise() then fetches the payloads.
  [[nodiscard]] std::vector<Result<TileRef>> find_all(std::span<const TileKey> keys) const;

  /// Verifies a stored tile's checksum, which reads the payload. bad_file names the key.
  [[nodiscard]] Result<void> check(const TileRef& tile) const;

  /// Fetches the payload unless it is present. In a local file it always is. Errors as
  /// RangeSource::fetch().
  [[nodiscard]] Result<void> fetch(const TileRef& tile) const;

  /// Asks the kernel to read the tiles' pages soon. Merges neighbouring ranges.
  void advise(std::span<const TileRef> tiles) const;

  /// Tells the kernel that this process no longer needs the tiles' pages (MADV_DONTNEED on the
  /// shared read-only map, which does not change the file).
  void release(std::span<const TileRef> tiles) const;
  /// The same for the whole map. Payloads in use stay valid: their pages fault back in.
  void release_all() const;

  /// The part of the file that holds a payload, for counting pages.
  [[nodiscard]] FileRange range(const TileRef& tile) const;

  /// The pages of the file that a reader of some tiles needs, ascending: those of the
  /// tree, of the records' tables and of the payloads. Touches no payload. Errors as find().
  [[nodiscard]] Result<std::vector<std::uint64_t>> pages(std::span<const TileKey> keys) const;

  /// The start of the map, for comparison with mincore and smaps; file_bytes() long.
  [[nodiscard]] const std::byte* map() const;

  /// Visits the tiles with keys in [from, to) in key order, except missing ones. Those that are the
  /// same as others are visited as such, not as find() has them. Calls `damaged` once for each
  /// damaged record, with the keys it should hold. Without `damaged` the iteration stops with that
  /// error. An error of the visitor stops the iteration and is returned.
  using Visitor = std::function<Result<void>(const TileRef&)>;
  using DamageVisitor = std::function<void(const Damage&)>;
  [[nodiscard]] Result<void> visit(TileKey from, TileKey to, const Visitor& visitor,
                                   const DamageVisitor& damaged = {}) const;

  /// Counts the tiles. Reads the records' tables but no payload. bad_file: a page or record is
  /// damaged. REQUIRES: the ends of the range are those of levels or states.
  [[nodiscard]] Result<TileStatistics> statistics(const TileRange& keys) const;

  /// Those of these keys that records cover, missing tiles among them, and those of damaged or lost
  /// records, as ascending ranges. All other tiles are missing. Linear in the number of records.
  [[nodiscard]] Result<std::vector<TileRange>> covered(const TileRange& keys) const;

  /// Checks every page of the file: each is reachable exactly once, within bounds and in order, or
  /// in the free list. Appends one error per finding.
  void check_structure(std::vector<Error>& findings) const;

 private:
  explicit TileStore(std::shared_ptr<const internal::Snapshot> snapshot)
      : snapshot_(std::move(snapshot)) {}
  /// find() and find_all(), which do not give a tile the payload of the one that it is the same as.
  [[nodiscard]] Result<TileRef> find_own(TileKey key) const;
  [[nodiscard]] std::vector<Result<TileRef>> find_own(std::span<const TileKey> keys) const;

  std::shared_ptr<const internal::Snapshot> snapshot_;
};

}  // namespace slf::storage
