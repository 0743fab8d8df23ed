// RecordBuilder: turns a layer's stream of tiles into records that fill whole pages.
//
// LMDB stores a large value in whole pages, after a header of 16 bytes, and the rest of the last
// page is wasted. So a record ends where little is wasted: from 64 KiB on, after the first tile
// that leaves less than 1/256 of the record unused; if there is none before 256 KiB, after the best
// tile so far. The end of a record depends only on its own tiles, not on commits. So a build that
// was interrupted, and resumed at the end of a record, writes the same records.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "base/bytes.h"
#include "storage/internal/record.h"
#include "storage/tile_store.h"

namespace slf::storage::internal {

/// A complete record, ready to be written.
struct CutRecord {
  LayerId layer = 0;
  TileKey last;
  Bytes value;
};

/// Thread-safety: none.
class RecordBuilder {
 public:
  /// `previous` is the last key of the layer in the file, if any.
  RecordBuilder(LayerId layer, std::optional<TileKey> previous)
      : layer_(layer), previous_(previous) {}

  /// Adds a tile. Appends the records that this completes to `out`. REQUIRES: the key is above
  /// last(); the payload has at most kMaxPayload bytes, and none unless the tile is stored.
  void append(TileKey key, TileState state, ByteSpan payload, std::vector<CutRecord>& out);

  /// Completes the last record.
  void finish(std::vector<CutRecord>& out);

  /// The last key appended or in the file.
  [[nodiscard]] std::optional<TileKey> last() const {
    return held_.empty() ? previous_ : held_.back().key;
  }

 private:
  struct Held {
    TileKey key;
    TileState state = TileState::empty;
    Bytes payload;
    std::size_t record_bytes = 0;  ///< of a record that ends with this tile
  };

  void add(Held tile, std::vector<CutRecord>& out);
  [[nodiscard]] std::size_t best_cut() const;
  void cut(std::size_t tiles, std::vector<CutRecord>& out);

  LayerId layer_;
  std::optional<TileKey> previous_;
  std::vector<Held> held_;
  std::size_t code_bytes_ = 0;
  std::size_t stored_ = 0;
  std::size_t payload_bytes_ = 0;  ///< with padding
};

}  // namespace slf::storage::internal
