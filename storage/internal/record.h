// Record: a value in LMDB that holds consecutive tiles of one level. For the bytes see
// FORMAT.md, "Tile records".
//
// A record's key is that of its last tile, and the record states the last key of the previous
// record. So a search that finds a record knows that no other record can hold the tile, and a lost
// record is never mistaken for tiles that were not built.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/tile_store.h"

namespace slf::storage::internal {

inline constexpr std::size_t kRecordHeader = 36;
inline constexpr std::uint64_t kMaxTiles = 1024;      ///< indexes one record spans at most
inline constexpr std::size_t kMinRecordBytes = 2048;  ///< LMDB stores smaller values in tree pages
inline constexpr std::uint64_t kMaxPayload = std::uint64_t{1} << 30;
inline constexpr std::uint8_t kNoLevel = 255;

[[nodiscard]] std::uint64_t checksum(ByteSpan bytes, std::uint64_t seed = 0);

/// The state and index of a tile in one number, as files have them: the state is above 50 bits.
[[nodiscard]] std::uint64_t packed_index(TileKey key);
[[nodiscard]] TileKey unpacked_key(std::uint8_t level, std::uint64_t packed);

/// A record's key in the tree: the level, then the packed index, big-endian, so that LMDB's byte
/// order is the order of TileKey.
using RecordKey = std::array<std::byte, 9>;
[[nodiscard]] RecordKey encode_key(TileKey last);
/// No key if the bytes are not a record key.
[[nodiscard]] std::optional<TileKey> decode_key(ByteSpan bytes);

/// One tile of a record.
struct Tile {
  TileState state = TileState::missing;
  ByteSpan payload;  ///< empty if the Record views only the start of the value
  std::uint64_t checksum = 0;
  std::uint64_t offset = 0;  ///< of the payload in the value; set by reading
  std::uint64_t size = 0;    ///< of the payload; set by reading
  std::uint64_t back = 0;    ///< if it is the same: how many states before its own

  /// The key of the tile that has the payload of the tile `key`, which this is.
  [[nodiscard]] TileKey source(TileKey key) const { return in_state(key, key.state - back); }
};

/// A record whose header and table have been checked. Views the value.
class Record {
 public:
  /// bad_file: the value is no complete record, or its table does not match its checksum. The
  /// message says what is wrong; the caller adds the place.
  [[nodiscard]] static Result<Record> parse(ByteSpan value) { return parse(value, value.size()); }

  /// The same for the start of a value of `size` bytes. REQUIRES: `start` includes the table.
  [[nodiscard]] static Result<Record> parse(ByteSpan start, std::uint64_t size);

  /// The offset at which a record's table ends. REQUIRES: `start` has kRecordHeader bytes.
  [[nodiscard]] static std::uint64_t table_end(ByteSpan start);

  [[nodiscard]] const std::optional<TileKey>& previous() const { return previous_; }
  [[nodiscard]] TileKey first() const { return first_; }
  [[nodiscard]] TileKey last() const { return key(count_ - 1); }
  /// The key of the tile at a position.
  [[nodiscard]] TileKey key(std::uint32_t position) const {
    return {first_.level, first_.index + position, first_.state};
  }
  [[nodiscard]] std::uint32_t count() const { return count_; }
  [[nodiscard]] ByteSpan bytes() const { return value_; }

  /// Walks the table. Usage: for (Record::Walk walk(record); walk.next();) use(walk.tile());
  class Walk {
   public:
    explicit Walk(const Record& record);
    /// Moves to the next tile. False: there is none.
    [[nodiscard]] bool next();
    [[nodiscard]] const Tile& tile() const { return tile_; }
    [[nodiscard]] std::uint32_t position() const { return position_ - 1; }

   private:
    const Record* record_;
    ByteSpan table_;  // the codes that remain, and padding
    std::uint32_t position_ = 0;
    std::uint32_t stored_ = 0;
    std::size_t payload_ = 0;
    Tile tile_;
  };

  /// The tile at `position` < count().
  [[nodiscard]] Tile tile(std::uint32_t position) const;

 private:
  ByteSpan value_;          ///< or its start
  std::uint64_t size_ = 0;  ///< of the value
  TileKey first_;
  std::optional<TileKey> previous_;
  std::uint32_t count_ = 0;
  std::uint32_t stored_ = 0;
  bool has_same_ = false;      ///< whether tiles can be the same as earlier ones
  std::size_t checksums_ = 0;  ///< offset of the table of checksums
  std::size_t payloads_ = 0;   ///< offset of the first payload
};

/// Encodes the part of a record before the first payload: header, codes and checksums. The payloads
/// follow, each at a multiple of 8 bytes, and then zeros up to kMinRecordBytes. REQUIRES: 1 to
/// kMaxTiles tiles. Stored ones have a payload of at most kMaxPayload bytes and its checksum; the
/// others have none.
[[nodiscard]] Bytes encode_record_head(std::optional<TileKey> previous, TileKey first,
                                       std::span<const Tile> tiles);

/// Rounds up to the alignment of checksums and payloads.
[[nodiscard]] constexpr std::size_t align8(std::size_t offset) { return (offset + 7) / 8 * 8; }

/// How many bytes the code of a tile takes, mostly: one more may be needed beside tiles that are
/// the same as earlier ones.
[[nodiscard]] std::size_t code_bytes(const Tile& tile);

}  // namespace slf::storage::internal
