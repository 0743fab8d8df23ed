// LoadedTiles: the tiles of a TileCache within their budget, and the order in which they make room.
//
// Tiles move between lists, which takes no memory: so removals, and the end of a pin, cannot fail.
#pragma once

#include <algorithm>
#include <cstdint>
#include <list>
#include <optional>
#include <unordered_map>
#include <utility>

#include "field/tiles/page_table.h"
#include "field/tiles/read_epochs.h"
#include "field/tiles/tile_memory.h"
#include "slf/error.h"
#include "slf/tile.h"
#include "storage/tile_store.h"

namespace slf {

/// A tile that is loaded or being loaded.
struct LoadedTile {
  enum class Stage : std::uint8_t { absent, loading, done };
  using List = std::list<LoadedTile>;

  TilePage unlisted;         // of a tile of another state, which readers do not look for
  TilePage* page = nullptr;  // where readers find it, or `unlisted`
  const std::byte* first = nullptr;
  std::size_t bytes = 0;    // of the samples
  std::uint64_t cost = 0;   // bytes that it counts in the budget
  std::uint64_t epoch = 0;  // of its removal
  List::iterator place;     // in its list
  TileKey key;
  std::optional<TileKey> lacking;  // a tile that this one is predicted from, but was never built
  std::optional<Error> error;
  storage::TileRef ref;
  TileMemory::Block owned;   // what `first` points into
  std::uint32_t listed = 0;  // page.used when it last came among the tiles that nothing pins
  std::uint32_t pins = 0;
  unsigned chain = 0;  // through how many other states it is predicted
  Stage stage = Stage::absent;
};

/// For one thread at a time.
class LoadedTiles {
 public:
  explicit LoadedTiles(std::uint64_t budget) : budget_(budget) {}

  /// Null if the tile is absent.
  [[nodiscard]] LoadedTile* find(TileKey key) const;
  /// Adds an absent tile, which nothing pins. `page`: null if readers do not look for it.
  LoadedTile& add(TileKey key, TilePage* page);
  /// The bytes that a tile costs from now on.
  void set_cost(LoadedTile& tile, std::uint64_t bytes);

  void pin(LoadedTile& tile);
  /// `now`: the frame that counts as its last user.
  void unpin(LoadedTile& tile, std::uint32_t now);

  /// Removes the least recently used tiles until `bytes` more fit or all others are pinned. Whether
  /// readers may still see one, whose memory would be needed.
  bool remove_for(std::uint64_t bytes);
  /// The tiles that no reader can see any more. Destroy them without the lock.
  [[nodiscard]] LoadedTile::List take_garbage() { return std::exchange(garbage_, {}); }

  /// The one that is removed next; null if all are pinned.
  [[nodiscard]] LoadedTile* least_recently_used();
  /// Takes the stamps of all frames from all tiles.
  void clear_stamps();

  /// Whether nothing needs to be removed soon.
  [[nodiscard]] bool ample() const { return bytes_ < budget_ - budget_ / 8; }
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
  /// What pinned tiles leave of the budget.
  [[nodiscard]] std::uint64_t room() const { return budget_ - std::min(budget_, pinned_bytes_); }
  [[nodiscard]] ReadEpochs& epochs() { return epochs_; }

 private:
  /// Removes a tile from the table. It is freed when no reader can have found it.
  void remove(LoadedTile& tile);

  const std::uint64_t budget_;
  ReadEpochs epochs_;
  std::unordered_map<TileKey, LoadedTile::List::iterator, TileKeyHash> tiles_;  // idle_, pinned_
  LoadedTile::List idle_;     // that nothing pins, roughly from least to most recently used
  LoadedTile::List pinned_;   // all others
  LoadedTile::List removed_;  // that a reader may still see, in order of epochs
  LoadedTile::List garbage_;  // that no reader can see
  std::uint64_t bytes_ = 0, removed_bytes_ = 0, pinned_bytes_ = 0;
};

}  // namespace slf
