// PageTable: finds the loaded tiles of one level by their sections, without a lock.
//
// As in virtual texturing, an entry section and an exit section index the table directly. Readers
// look tiles up while the cache loads and removes others: the samples of a removed tile stay valid
// until every reader that may have found them has left its ReadScope (tile_cache.h).
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace slf {

/// A loaded tile, as readers find it. The cache writes `layers` last, so whoever finds a layer's
/// bit finds its samples. A page of no layers is not loaded.
struct alignas(32) TilePage {
  static constexpr std::uint32_t kColor = 1;         ///< colours are loaded, or known to be empty
  static constexpr std::uint32_t kDepth = 2;         ///< the same of depths
  static constexpr std::uint32_t kColorMissing = 4;  ///< never built
  static constexpr std::uint32_t kDepthMissing = 8;
  static constexpr std::uint32_t kPinFirst = 16;  ///< not to be read without a pin

  /// Whether a reader that finds the page can read all that a view needs of it.
  [[nodiscard]] static bool readable(std::uint32_t layers, bool with_depth) {
    const std::uint32_t wanted = with_depth ? kColor | kDepth : kColor;
    return (layers & (wanted | kPinFirst)) == wanted;
  }
  /// Whether anything that a view needs of the tile was never built.
  [[nodiscard]] static bool missing(std::uint32_t layers, bool with_depth) {
    return (layers & (with_depth ? kColorMissing | kDepthMissing : kColorMissing)) != 0;
  }

  /// The first sample, as codec::Tile lays them out; null where nothing is stored.
  std::atomic<const std::byte*> color{nullptr}, depth{nullptr};
  std::atomic<std::uint32_t> layers{0};
  std::atomic<std::uint32_t> used{0};  ///< the frame that used it last
};

/// Thread-safety: find() from any thread; make_page() from one at a time.
class PageTable {
 public:
  /// For a level with so many entry and exit sections. Takes hardly any memory before pages are
  /// made. Empty where there is not even address space for it.
  [[nodiscard]] static PageTable make(std::uint64_t entry_sections, std::uint64_t exit_sections);
  PageTable(PageTable&& other) noexcept;
  PageTable& operator=(PageTable&& other) noexcept;
  ~PageTable();

  /// Whether it is not empty; make_page() REQUIRES so.
  explicit operator bool() const { return chunks_ != nullptr; }

  /// The page of a tile, or null where it was never made. Lives as long as the table.
  [[nodiscard]] TilePage* find(std::uint32_t entry, std::uint32_t exit) const {
    if (!chunks_) return nullptr;
    Chunk* chunk = chunks_[entry * chunks_across_ + exit / kChunk].load(std::memory_order_acquire);
    return chunk ? &chunk->pages[exit % kChunk] : nullptr;
  }

  /// The page of a tile, made if need be together with its neighbours.
  [[nodiscard]] TilePage& make_page(std::uint32_t entry, std::uint32_t exit);

 private:
  PageTable() = default;

  static constexpr std::uint32_t kChunk = 16;  // pages that are made together
  struct Chunk {
    TilePage pages[kChunk];
  };

  std::atomic<Chunk*>* chunks_ = nullptr;  // [entry][exit / kChunk]
  std::size_t chunks_across_ = 0;          // for each entry section
  std::size_t chunk_count_ = 0;
  std::vector<std::unique_ptr<Chunk>> owned_;
};

}  // namespace slf
