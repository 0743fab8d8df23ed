// TileCache: the loaded tiles of one field, within a byte budget.
//
// The states of a tile, and who may read it in each, are in ARCHITECTURE.md. In a file a tile is
// stored, empty or missing (storage::TileState); absent means that the cache does not have it.
//
// Renderers find tiles without a lock: inside a ReadScope, page_table() maps a pair of sections to
// a TilePage. They load() absent tiles: each is found in the file, checked and decoded once, while
// other threads that need it wait. Over budget, the least recently used tiles are removed,
// and their memory is freed when no ReadScope can have found them. A Pin keeps a tile loaded. Only
// pinned tiles can exceed the budget, so keep few pins at a time.
//
// The tiles of a composed field are made of those of its structures, each of which has a cache of
// its own.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

#include "base/fork.h"
#include "field/field_file.h"
#include "field/tiles/loaded_tiles.h"
#include "field/tiles/page_table.h"
#include "field/tiles/tile_memory.h"
#include "slf/error.h"
#include "slf/tile_reader.h"

namespace slf {

struct CacheStatistics {
  std::uint64_t decodes = 0;             ///< tiles decoded, once per load
  std::uint64_t decoded_bytes = 0;       ///< in the cache now
  std::uint64_t decoded_peak_bytes = 0;  ///< most bytes in the cache at any time
  /// Payloads read from the start, with those of tiles that others are predicted from.
  std::uint64_t loaded_bytes = 0;
};

/// Thread-safety: any thread, except where a member says otherwise.
class TileCache {
  class ScopedLock;

 public:
  /// Readable bytes before a tile's first sample, for loads of several bytes that end with a
  /// sample. Their values are unspecified.
  static constexpr std::size_t kReadableBefore = 8;

  /// A tile that stays loaded while this lives. Move-only; must not outlive the cache.
  class Pin {
   public:
    Pin() = default;
    Pin(Pin&& other) noexcept : cache_(other.cache_), tile_(std::exchange(other.tile_, nullptr)) {}
    Pin& operator=(Pin&& other) noexcept;
    ~Pin() { release(); }

    // REQUIRES of what follows: the pin came from load() or read() and was not moved from.

    /// Whether the tile is stored; missing also if a tile that it is predicted from is.
    [[nodiscard]] storage::TileState state() const;
    /// The samples, in the layout of TileShape; none if the tile is not stored.
    [[nodiscard]] ByteSpan samples() const;

   private:
    friend class TileCache;
    Pin(TileCache* cache, LoadedTile* tile) : cache_(cache), tile_(tile) {}
    void release();

    TileCache* cache_ = nullptr;
    LoadedTile* tile_ = nullptr;
  };

  /// A thread that looks up tiles in page_table(), and the time in which it does. In a ReadScope
  /// do not call load(): that may wait for memory of removed tiles, which is freed only after it.
  using Reader = ReadEpochs::Reader;
  using ReadScope = ReadEpochs::Scope;
  [[nodiscard]] ReadEpochs& epochs() { return tiles_.epochs(); }

  /// The field must outlive this. `budget`: bytes of decoded samples. `state`: that whose tiles are
  /// in page_table(). `structures`: null unless the field is composed; they share the budget.
  TileCache(const FieldFile& field, std::uint64_t budget, unsigned state = 0,
            const std::vector<Structure>* structures = nullptr);
  ~TileCache();

  /// Whether this process was forked while threads used this, which may be locked for ever. Then
  /// load() and check_level() fail, pins end without a trace, and nothing else may be called, not
  /// even the destructor.
  [[nodiscard]] bool lost() const { return forks_ != torn_forks(); }

  [[nodiscard]] const FieldFile& field() const { return field_; }
  [[nodiscard]] unsigned state() const { return state_; }
  [[nodiscard]] std::uint64_t budget() const { return budget_; }

  /// unsupported: the level needs larger tables than the budget, or than such a file can fill, or
  /// more address space than there is. Then its page_table() is empty, and load() fails.
  [[nodiscard]] Result<void> check_level(unsigned level) const;
  /// The table of a level, to find tiles inside ReadScopes.
  [[nodiscard]] const PageTable& page_table(unsigned level) const { return tables_[level]; }

  /// Begins a frame and returns its number, which its tiles get in TilePage::used. A frame whose
  /// caller does not want the list of its tiles (`lists_tiles` is false) may share the number of
  /// the frame before while the cache has room: then its kernels find the tiles of that frame as
  /// fast as its own, and no removal needs to know which of the two is older.
  [[nodiscard]] std::uint32_t begin_frame(bool lists_tiles = true);
  /// The number of a frame after it has waited for tiles: while memory is short, a new one, so that
  /// tiles that it uses from then on count as used more recently than those that it no longer uses.
  [[nodiscard]] std::uint32_t resume_frame(std::uint32_t frame);

  /// Finds tiles, and those that they are predicted from, except what is loaded, and asks the
  /// kernel to read all of them. Call it with all tiles that are needed next, so that the disk
  /// reads many at a time.
  [[nodiscard]] FoundTiles find(std::span<const TileKey> keys);

  /// Loads tiles and pins them, in the order of `keys`. What find() has `found` is not looked up
  /// again. Empty and missing tiles are no errors: Pin::state() tells. REQUIRES: no ReadScope of
  /// the calling thread, and keys of the field. Errors of finding, checking and decoding, which are
  /// not cached. unsupported: a level too large for the address space.
  [[nodiscard]] Result<std::vector<Pin>> load(std::span<const TileKey> keys,
                                              const FoundTiles& found);
  [[nodiscard]] Result<std::vector<Pin>> load(std::span<const TileKey> keys) {
    return load(keys, find(keys));
  }
  [[nodiscard]] Result<Pin> load(TileKey key, const FoundTiles& found);
  [[nodiscard]] Result<Pin> load(TileKey key) { return load(key, find({&key, 1})); }

  /// Loads a stored tile. tile_missing: one that it is predicted from was never built; the message
  /// names that.
  [[nodiscard]] Result<Pin> read(TileKey key, const FoundTiles& found);
  [[nodiscard]] Result<Pin> read(TileKey key) { return read(key, find({&key, 1})); }
  /// The same, copied; all zeros if it is empty.
  [[nodiscard]] Result<void> read(TileKey key, Bytes& samples);

  /// The number of the frame that began last.
  [[nodiscard]] std::uint32_t now() const { return clock_.load(); }
  /// Whether more tiles can be loaded without removing tiles that `frame` or a later one used, or
  /// that were loaded since `frame` began.
  [[nodiscard]] bool has_room(std::uint32_t frame);

  [[nodiscard]] CacheStatistics statistics() const;
  void reset_peak();

 private:
  /// failed: see lost().
  [[nodiscard]] Result<void> check_kept() const;
  void unpin(LoadedTile& tile);
  /// Shows readers that a tile is loaded.
  void publish_locked(LoadedTile& tile);
  /// Loads tiles of one level and pins them. References are loaded before, each once for as many
  /// tiles as there is room for: in little memory, tiles that were loaded one after the other would
  /// evict each other's.
  [[nodiscard]] Result<std::vector<Pin>> load_level(std::span<const TileKey> keys,
                                                    const FoundTiles& found);
  /// Pins those of the tiles that are loaded, and returns the indices of the others.
  [[nodiscard]] std::vector<std::size_t> pin_loaded(std::span<const TileKey> keys,
                                                    std::span<Pin> pins);
  struct Batch {
    std::size_t tiles = 0;
    std::vector<TileKey> references;  ///< of these tiles, ascending
  };
  /// As many of the first absent tiles as fit with their references, at least one.
  [[nodiscard]] Batch next_batch(std::span<const TileKey> keys, std::span<const std::size_t> absent,
                                 const FoundTiles& found);
  /// Loads a tile, or waits for the thread that does. Loads depend on coarser levels and earlier
  /// states only, so threads never wait for each other in a circle.
  [[nodiscard]] Result<Pin> load_one(TileKey key, const FoundTiles& found);
  /// Finds a tile, loads its references, and decodes it.
  [[nodiscard]] Result<void> load_samples(LoadedTile& tile, const FoundTiles& found);
  /// The same for a tile of a composed field.
  [[nodiscard]] Result<void> compose(LoadedTile& tile);
  /// The memory for a tile's samples.
  [[nodiscard]] std::span<std::byte> allocate(LoadedTile& tile, std::size_t bytes);
  /// Before a tile gets memory for `bytes` bytes of samples: removes others until these fit into
  /// the budget, where the tile counts with them from now on. Waits for memory of removed tiles
  /// that is still read.
  void charge(LoadedTile& tile, std::uint64_t bytes);

  struct Part {
    std::unique_ptr<TileCache> cache;
    glm::vec4 factor;  ///< TileLayer::factor
  };

  const FieldFile& field_;
  const unsigned state_;
  const unsigned forks_ = torn_forks();
  const bool composed_;
  std::vector<Part> parts_;  // the structures, if the field is composed
  const std::uint64_t budget_;
  std::vector<PageTable> tables_;                // by level; changed under the lock
  std::atomic<std::uint32_t> clock_{0};          // number of the frame that began last
  std::atomic<std::uint64_t> payload_bytes_{0};  // decoded so far
  std::atomic<std::uint32_t> loading_{0};        // calls of load() under way

  TileMemory memory_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable loaded_;
  LoadedTiles tiles_;
  bool shared_ = false;  // whether frames may share the last number
  CacheStatistics statistics_;
};

}  // namespace slf
