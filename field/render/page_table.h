// PageTable: finds the loaded tiles of one level by their sections, without a lock.
//
// As in virtual texturing, an entry section and an exit section index the table directly. Readers
// look tiles up while the cache adds and removes others: a removed page stays valid until every
// reader that may have found it has left its ReadScope (tile_cache.h).
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "slf/tile.h"

namespace slf {

/// What readers see of a tile in the cache. `layers` is stored last, with release: whoever finds a
/// layer's bit finds its samples.
struct TilePage {
  static constexpr std::uint32_t kColor = 1;  ///< the colours are loaded, or known to be empty
  static constexpr std::uint32_t kDepth = 2;  ///< the same of depths
  static constexpr std::uint32_t kColorMissing = 4;  ///< never built
  static constexpr std::uint32_t kDepthMissing = 8;

  /// Whether all that a view wants of the tile is loaded.
  [[nodiscard]] static bool loaded(std::uint32_t layers, bool with_depth) {
    const std::uint32_t wanted = with_depth ? kColor | kDepth : kColor;
    return (layers & wanted) == wanted;
  }
  /// Whether anything that a view wants of the tile was never built.
  [[nodiscard]] static bool missing(std::uint32_t layers, bool with_depth) {
    return (layers & (with_depth ? kColorMissing | kDepthMissing : kColorMissing)) != 0;
  }

  TileKey key;
  const std::byte* color =
      nullptr;  ///< the first sample, as codec::Tile lays them out; null: empty
  const std::byte* depth = nullptr;
  std::atomic<std::uint32_t> layers{0};
  mutable std::atomic<std::uint32_t> used{0};  ///< the frame that used it last
};

/// Thread-safety: find() from any thread, inside a ReadScope; the rest from one thread at a time.
class PageTable {
 public:
  /// For a level with so many entry and exit sections. Memory is reserved, not used: 8 bytes for
  /// each tile that is ever loaded, in pieces of 64. Empty where there is not even address space.
  [[nodiscard]] static PageTable make(std::uint64_t entry_sections, std::uint64_t exit_sections);
  PageTable(PageTable&& other) noexcept;
  PageTable& operator=(PageTable&& other) noexcept;
  ~PageTable();

  /// Whether it is not empty; the rest REQUIRES so.
  explicit operator bool() const { return chunks_ != nullptr; }

  /// The page of a tile, or null where none is loaded.
  [[nodiscard]] const TilePage* find(std::uint32_t entry, std::uint32_t exit) const {
    const Chunk* chunk =
        chunks_[entry * chunks_across_ + exit / kChunk].load(std::memory_order_acquire);
    return chunk ? chunk->pages[exit % kChunk].load(std::memory_order_acquire) : nullptr;
  }

  /// Publishes a page, or with null removes it.
  void set(std::uint32_t entry, std::uint32_t exit, const TilePage* page);

 private:
  PageTable() = default;

  static constexpr std::uint32_t kChunk = 64;
  struct Chunk {
    std::atomic<const TilePage*> pages[kChunk];
  };

  std::atomic<Chunk*>* chunks_ = nullptr;  // [entry][exit / kChunk]
  std::size_t chunks_across_ = 0;          // for each entry section
  std::size_t chunk_count_ = 0;
  std::vector<std::unique_ptr<Chunk>> owned_;
};

}  // namespace slf
