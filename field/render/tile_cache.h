// TileCache: decoded tiles of one field, within a byte budget.
//
// A tile is found, checked and decoded once, by whoever asks first; others wait for it. Pinned
// tiles stay; of the rest, the least recently used are dropped when the budget is reached. Only
// pinned tiles can exceed it: keep few pins at a time.
//
// Tiles of an in-place codec (raw) are views of the map and cost nothing here. What the map keeps
// resident has a budget of its own: when about that much was read through it, all of it is
// released; what is still in use comes back page by page.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "field/field_file.h"
#include "slf/error.h"
#include "slf/render.h"

namespace slf {

struct CacheStatistics {
  std::uint64_t decodes = 0;
  std::uint64_t decoded_bytes = 0;       ///< kept now
  std::uint64_t decoded_peak_bytes = 0;  ///< the most kept at any time
  std::uint64_t loaded_bytes = 0;        ///< payloads that were read, from the start
};

class TileCache {
  struct Entry;
  struct Part;
  class Hold;

 public:
  /// Bytes before a tile's samples that can be read, whatever they are: loads of several bytes may
  /// end with a sample instead of beginning with it.
  static constexpr std::size_t kBefore = 8;

  /// A tile that cannot be evicted while this lives. Move-only; must not outlive the cache.
  class Pin {
   public:
    Pin() = default;
    Pin(Pin&& other) noexcept
        : cache_(other.cache_), entry_(std::exchange(other.entry_, nullptr)) {}
    Pin& operator=(Pin&& other) noexcept;
    ~Pin() { release(); }

    /// Whether there is a tile at all.
    explicit operator bool() const { return entry_ != nullptr; }
    /// Whether it was never built: its colours or, if they are wanted (and were asked for), its
    /// depths. This and the rest REQUIRE a tile.
    [[nodiscard]] bool missing(bool with_depth) const;
    /// The samples of a stored tile, as codec::Tile lays them out; null when empty or missing.
    [[nodiscard]] const std::byte* color() const;
    /// The same of the depth layer. REQUIRES that it was asked for.
    [[nodiscard]] const std::byte* depth() const;

   private:
    friend class TileCache;
    Pin(TileCache* cache, Entry* entry) : cache_(cache), entry_(entry) {}
    void release();

    TileCache* cache_ = nullptr;
    Entry* entry_ = nullptr;
  };

  /// Borrows the field. `budget` bytes of decoded samples, `map_budget` resident bytes of the map;
  /// the latter can be exceeded by the pinned tiles of an in-place codec.
  /// Unless `in_place`, tiles of in-place codecs are copied out of the map too.
  TileCache(const FieldFile& field, std::uint64_t budget, std::uint64_t map_budget = kUnlimited,
            bool in_place = true);
  ~TileCache();

  /// A tile, and where its payloads are in the file as far as that was looked up.
  struct Located {
    TileKey key;
    std::optional<storage::TileRef> color{}, depth{};
  };

  /// A tile's colour and, if it has any and they are wanted, depths. Thread-safe. Any error of
  /// finding, checking or decoding; it is not remembered.
  [[nodiscard]] Result<Pin> get(const Located& tile, bool with_depth);

  /// The tiles that are loaded already; where one is not, an empty pin. Thread-safe; waits for
  /// nobody.
  [[nodiscard]] std::vector<Pin> find(std::span<const TileKey> keys, bool with_depth);

  /// Lets go of many pins at once.
  void release(std::span<Pin> pins);

  /// Looks up the tiles that are not here yet and asks the kernel to read their payloads: call it
  /// with all that will be wanted next, so that the disk works on many at a time, and get() what it
  /// returns, in the order of the keys.
  [[nodiscard]] std::vector<Located> locate(std::span<const TileKey> keys, bool with_depth);

  /// A clock that ticks as tiles are used.
  [[nodiscard]] std::uint64_t now() const;
  /// Whether more can be loaded without dropping what was used since then.
  [[nodiscard]] bool has_room(std::uint64_t since) const;

  [[nodiscard]] CacheStatistics statistics() const;
  void reset_peak();

 private:
  struct Hash {
    std::size_t operator()(TileKey key) const {
      return (key.index * 0x9E3779B97F4A7C15u) ^ (std::size_t{key.level} << 56);
    }
  };

  /// The entries that nobody pins, least recently used first, as a ring through `idle_`.
  struct Link {
    Link* before = this;
    Link* after = this;
  };

  void pin_locked(Entry& entry);
  void unpin(Entry& entry);
  void unpin_locked(Entry& entry);
  void evict_locked(std::uint64_t budget);
  void drop_locked(Entry& entry);
  /// Counts the pages that finding a tile brings into the map, or using it there, and has all of
  /// them released when due.
  void map_locked(const storage::TileRef& tile, bool used);
  /// Makes room for a part of an entry and counts it.
  void charge(Entry& entry, const Part& part, std::uint64_t bytes, bool located);
  /// Loads a part, or waits for whoever does.
  [[nodiscard]] Result<void> bring(std::unique_lock<std::mutex>& lock, Entry& entry, Part& part,
                                   storage::LayerId layer,
                                   const std::optional<storage::TileRef>& located);
  [[nodiscard]] Result<void> load(Entry& entry, Part& part, storage::LayerId layer,
                                  const std::optional<storage::TileRef>& located);
  [[nodiscard]] std::optional<storage::LayerId> depth_of(bool wanted) const {
    return wanted ? depth_ : std::nullopt;
  }

  const FieldFile& field_;
  const storage::LayerId color_;
  const std::optional<storage::LayerId> depth_;
  const std::uint64_t budget_, map_budget_;
  const bool in_place_;
  mutable std::mutex mutex_;
  std::condition_variable loaded_;
  using Entries = std::unordered_map<TileKey, Entry, Hash>;
  Entries entries_;
  std::vector<Entries::node_type> dropped_;  // entries to be freed
  bool release_due_ = false;                 // of the map
  Link idle_;
  std::uint64_t mapped_bytes_ = 0;   // read through the map since it was last released, about
  std::uint64_t mapped_window_ = 0;  // the window that was read last
  std::uint64_t clock_ = 0;
  CacheStatistics statistics_;
};

}  // namespace slf
