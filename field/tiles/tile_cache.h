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
// Tiles of an in-place codec (raw) are views of the map and do not count. The resident pages of the
// map have a budget of their own: when about that much was read through the map, all of it is
// released, and pages still in use fault back in.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <list>
#include <mutex>
#include <optional>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "field/field_file.h"
#include "field/tiles/page_table.h"
#include "field/tiles/tile_memory.h"
#include "slf/error.h"
#include "slf/tile_reader.h"

namespace slf {

struct CacheStatistics {
  std::uint64_t decodes = 0;             ///< tiles decoded or copied, once per load
  std::uint64_t decoded_bytes = 0;       ///< in the cache now
  std::uint64_t decoded_peak_bytes = 0;  ///< most bytes in the cache at any time
  /// Payloads read from the start, with those of tiles that others are predicted from.
  std::uint64_t loaded_bytes = 0;
};

/// Thread-safety: any thread, except where a member says otherwise.
class TileCache {
  struct Tile;  // a tile that is loaded or being loaded
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

    [[nodiscard]] TilePage& page() const;
    /// Whether the tile is stored; missing also if a tile that it is predicted from is.
    [[nodiscard]] storage::TileState state() const;
    /// The samples, in the layout of TileShape; none if the tile is not stored.
    [[nodiscard]] ByteSpan samples() const;

   private:
    friend class TileCache;
    Pin(TileCache* cache, Tile* tile) : cache_(cache), tile_(tile) {}
    void release();

    TileCache* cache_ = nullptr;
    Tile* tile_ = nullptr;
  };

  /// Registers a thread that looks up tiles in page_table(). Made once, used for many ReadScopes,
  /// one at a time. Must not outlive the cache.
  class Reader {
   public:
    explicit Reader(TileCache& cache);
    ~Reader();
    Reader(const Reader&) = delete;
    Reader& operator=(const Reader&) = delete;

   private:
    friend class TileCache;
    struct alignas(64) Slot {
      std::atomic<std::uint64_t> epoch{0};  // when its ReadScope began; 0: in none
      bool taken = false;
    };

    TileCache& cache_;
    Slot* slot_;
  };

  /// During its lifetime the samples of every tile found in it stay valid. Keep it short, and do
  /// not call load() in it: load() may wait for memory of removed tiles, which is freed only after
  /// it ends.
  class ReadScope {
   public:
    explicit ReadScope(Reader& reader);
    ~ReadScope();
    ReadScope(const ReadScope&) = delete;
    ReadScope& operator=(const ReadScope&) = delete;

   private:
    Reader& reader_;
  };

  /// The field must outlive this. `budget` bytes of decoded samples, `map_budget` resident bytes of
  /// the map; pinned tiles of an in-place codec can exceed the latter. Unless `in_place`, tiles of
  /// in-place codecs are copied out of the map too.
  TileCache(const FieldFile& field, std::uint64_t budget, std::uint64_t map_budget = kUnlimited,
            bool in_place = true);
  ~TileCache();

  [[nodiscard]] const FieldFile& field() const { return field_; }
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

  /// Loads tiles and pins them, in the order of `keys`. Empty and missing tiles are no errors:
  /// Pin::state() tells. REQUIRES: no ReadScope of the calling thread, and keys of the field.
  /// Errors of finding, checking and decoding, which are not cached. unsupported: a level too large
  /// for the address space.
  [[nodiscard]] Result<std::vector<Pin>> load(std::span<const TileKey> keys);

  /// A tile, and its payload in the file if that was looked up.
  struct Located {
    TileKey key;
    std::optional<storage::TileRef> ref{};
  };

  /// The first half of load(): finds the payloads of tiles that are not loaded, and asks the kernel
  /// to read them. Call it with all tiles that are needed next, so that the disk reads many at a
  /// time.
  [[nodiscard]] std::vector<Located> locate(std::span<const TileKey> keys);
  /// The second half, for one tile.
  [[nodiscard]] Result<Pin> load(const Located& tile);

  /// Loads a stored tile. tile_missing: one that it is predicted from was never built; the message
  /// names that.
  [[nodiscard]] Result<Pin> read(const storage::TileRef& tile);

  /// The same, copied into `samples`, which has the tile's size.
  [[nodiscard]] Result<void> read(const storage::TileRef& tile, std::span<std::byte> samples);

  /// Codes a tile for this field; if its codec is predictive, as a difference from what the tiles
  /// of the next coarser level predict. Errors of load().
  [[nodiscard]] Result<void> encode(TileKey key, ByteSpan samples, Bytes& payload);

  /// The number of the frame that began last.
  [[nodiscard]] std::uint32_t now() const { return clock_.load(); }
  /// Whether more tiles can be loaded without removing tiles that `frame` or a later one used, or
  /// that were loaded since `frame` began.
  [[nodiscard]] bool has_room(std::uint32_t frame);

  [[nodiscard]] CacheStatistics statistics() const;
  void reset_peak();

 private:
  /// Tiles move between lists, which takes no memory: so removals, and the end of a Pin, cannot
  /// fail.
  using Tiles = std::list<Tile>;

  void pin_locked(Tile& tile);
  void unpin(Tile& tile);
  void unpin_locked(Tile& tile);
  /// Shows readers that a tile is loaded.
  void publish_locked(Tile& tile);
  /// Whether nothing needs to be removed soon.
  [[nodiscard]] bool ample_locked() const;
  [[nodiscard]] Tile* least_recently_used_locked();
  /// Removes a tile from the table. It is freed when no reader can have found it.
  void remove_locked(Tile& tile);
  void free_removed_locked();
  /// Removes tiles until `bytes` more fit or all others are pinned.
  void remove_for_locked(std::uint64_t bytes);
  /// The same, and waits until the removed tiles are freed.
  void make_room(std::unique_lock<std::mutex>& lock, std::uint64_t bytes);
  /// Counts the pages of the map that finding a tile, or reading it there, makes resident; has the
  /// map released when its budget is used up.
  void count_mapped_locked(const storage::TileRef& tile, bool read);
  /// locate(); only if `advise`, the kernel is asked to read.
  [[nodiscard]] std::vector<Located> find(std::span<const TileKey> keys, bool advise);
  [[nodiscard]] Result<std::vector<Pin>> load_all(std::vector<Located> tiles);
  /// Loads tiles of one level and pins them. References are loaded before, each once for as many
  /// tiles as there is room for: in little memory, tiles that were loaded one after the other would
  /// evict each other's.
  [[nodiscard]] Result<std::vector<Pin>> load_level(std::vector<Located> tiles);
  /// Pins those of the tiles that are loaded, and returns the indices of the others.
  [[nodiscard]] std::vector<std::size_t> pin_loaded(std::span<const Located> tiles,
                                                    std::span<Pin> pins);
  struct Batch {
    std::size_t tiles = 0;
    std::vector<TileKey> references;  ///< of these tiles, ascending
  };
  /// As many of the first absent tiles as fit with their references, at least one.
  [[nodiscard]] Batch next_batch(std::span<Located> tiles, std::span<const std::size_t> absent);
  /// What a tile is predicted from, according to its payload. Finds that if it was not looked up.
  [[nodiscard]] std::vector<TileKey> references_of(Located& tile) const;
  [[nodiscard]] Result<Pin> load_one(const Located& tile);
  /// Loads a tile, or waits for the thread that does.
  [[nodiscard]] Result<void> load_once(std::unique_lock<std::mutex>& lock, Tile& tile,
                                       const std::optional<storage::TileRef>& located);
  [[nodiscard]] Result<void> load_samples(Tile& tile,
                                          const std::optional<storage::TileRef>& located);
  /// Makes room for a tile and counts it.
  void charge(Tile& tile, std::uint64_t bytes, bool located);
  /// Pins the tiles that another one is predicted from, and loads those that load_level() did not.
  /// Loads depend on coarser levels only, so threads never wait for each other in a circle.
  /// tile_missing: the tile was never built; then `lacking` is its key.
  [[nodiscard]] ReferenceSource references(std::vector<Pin>& pins, std::optional<TileKey>& lacking);

  const FieldFile& field_;
  const std::uint64_t budget_, map_budget_;
  const bool in_place_;
  std::vector<PageTable> tables_;                // by level; changed under the lock
  std::atomic<std::uint32_t> clock_{0};          // number of the frame that began last
  std::atomic<std::uint64_t> epoch_{1};          // removals so far
  std::atomic<std::uint64_t> payload_bytes_{0};  // decoded so far
  std::atomic<std::uint32_t> loading_{0};        // calls of load_all() under way

  TileMemory memory_;

  mutable std::mutex mutex_;  // guards what follows
  std::condition_variable loaded_;
  std::deque<Reader::Slot> readers_;
  std::unordered_map<TileKey, Tiles::iterator, TileKeyHash> tiles_;  // in idle_ or pinned_
  Tiles idle_;                       // that nothing pins, roughly from least to most recently used
  Tiles pinned_;                     // all others
  Tiles removed_;                    // that a reader may still see, in order of epochs
  Tiles garbage_;                    // that no reader can see; freed outside the lock
  std::uint64_t removed_bytes_ = 0;  // of removed_
  std::uint64_t pinned_bytes_ = 0;   // of loaded tiles that are pinned
  bool shared_ = false;              // whether frames may share the last number
  bool release_due_ = false;         // of the map
  std::uint64_t mapped_bytes_ = 0;   // approximate, read through the map since its last release
  std::uint64_t mapped_window_ = 0;  // the window that was read last
  CacheStatistics statistics_;
};

}  // namespace slf
