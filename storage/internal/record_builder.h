// RecordBuilder: turns a stream of tiles into records that fill whole pages.
//
// LMDB stores a large value in whole pages, after a header of 16 bytes, and the rest of the last
// page is wasted. So a record ends where little is wasted: from 64 KiB on, after the first tile
// that leaves less than 1/256 of the record unused. If there is no such tile before 256 KiB, it
// ends after the tile that wastes least. The end of a record depends on its own tiles only, not on
// commits. So a build that is interrupted and resumes at the end of a record writes the same
// records.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "storage/internal/record.h"
#include "storage/tile_store.h"

namespace slf::storage::internal {

/// A complete record, ready to be written.
struct CompleteRecord {
  TileKey last;
  Bytes head;  ///< the bytes before the payloads
  std::vector<ByteSpan> payloads;
  std::vector<Bytes> own{};  ///< payloads that nothing else holds

  /// The size of the whole record.
  [[nodiscard]] std::size_t bytes() const;
  /// Writes the record. REQUIRES: `to` has bytes() bytes.
  void write(std::span<std::byte> to) const;
};

/// A tile to append.
struct NewTile {
  TileKey key;
  TileState state = TileState::empty;
  Bytes payload = {};
  std::uint64_t back = 0;        ///< as Tile::back
  std::size_t record_bytes = 0;  ///< of a record that ends with this tile; set by RecordBuilder
};

/// Thread-safety: none.
class RecordBuilder {
 public:
  /// `previous` is the last key in the file, if any.
  explicit RecordBuilder(std::optional<TileKey> previous = {}) : previous_(previous) {}

  /// Adds a tile. Appends the records that this completes to `out`. REQUIRES: the key is above
  /// last(); the payload has at most kMaxPayload bytes, and none unless the tile is stored.
  void append(NewTile tile, std::vector<CompleteRecord>& out);

  /// Completes the last record.
  void finish(std::vector<CompleteRecord>& out);

  /// The last key appended or in the file.
  [[nodiscard]] std::optional<TileKey> last() const {
    return pending_.empty() ? previous_ : pending_.back().key;
  }

 private:
  [[nodiscard]] std::size_t best_record_end() const;
  void end_record(std::size_t tiles, std::vector<CompleteRecord>& out);

  std::optional<TileKey> previous_;
  std::vector<NewTile> pending_;
  std::size_t code_bytes_ = 0;
  std::size_t stored_ = 0;
  std::size_t payload_bytes_ = 0;  ///< with padding
};

}  // namespace slf::storage::internal
