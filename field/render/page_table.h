// PageTable: finds the loaded tiles of one level by their sections, without a lock.
//
// As in virtual texturing, an entry section and an exit section index the table directly, so one
// load finds a tile. Readers look tiles up while the cache loads and removes others: the samples
// of a removed tile stay valid until every reader that may have found them has left its ReadScope
// (tile_cache.h).
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace slf {

/// A tile, as readers find it. The cache writes `layers` last, so whoever finds a layer's bit finds
/// its samples. A page of no layers is not loaded.
struct alignas(32) TilePage {
  static constexpr std::uint32_t kColor = 1;         ///< colours are loaded, or known to be empty
  static constexpr std::uint32_t kDepth = 2;         ///< the same of depths
  static constexpr std::uint32_t kColorMissing = 4;  ///< never built
  static constexpr std::uint32_t kDepthMissing = 8;
  static constexpr std::uint32_t kPinFirst = 16;  ///< not to be read without a pin

  /// The bits of the layers that a view needs, and of those which say that one was never built.
  [[nodiscard]] static constexpr std::uint32_t needed(bool with_depth) {
    return with_depth ? kColor | kDepth : kColor;
  }
  [[nodiscard]] static constexpr std::uint32_t missing_bits(bool with_depth) {
    return with_depth ? kColorMissing | kDepthMissing : kColorMissing;
  }
  /// Whether a reader that finds the page can read all that a view needs of it.
  [[nodiscard]] static bool readable(std::uint32_t layers, bool with_depth) {
    return (layers & (needed(with_depth) | kPinFirst)) == needed(with_depth);
  }
  /// Whether anything that a view needs of the tile was never built.
  [[nodiscard]] static bool missing(std::uint32_t layers, bool with_depth) {
    return (layers & missing_bits(with_depth)) != 0;
  }

  /// The first sample, as codec::Tile lays them out; null where nothing is stored.
  std::atomic<const std::byte*> color{nullptr}, depth{nullptr};
  /// Kernels load both as one number, `used` above `layers`.
  std::atomic<std::uint32_t> layers{0};
  std::atomic<std::uint32_t> used{0};  ///< the frame that used it last
};
static_assert(sizeof(TilePage) == 32);

/// Thread-safety: any thread.
class PageTable {
 public:
  /// For a level with so many entry and exit sections; the latter are a power of two. Takes no
  /// memory where no page was written. Empty where there is not even address space for it.
  [[nodiscard]] static PageTable make(std::uint64_t entry_sections, std::uint64_t exit_sections);
  PageTable(PageTable&& other) noexcept;
  PageTable& operator=(PageTable&& other) noexcept;
  ~PageTable();

  /// Whether it is not empty.
  explicit operator bool() const { return pages_ != nullptr; }

  /// The page of a tile; null in an empty table. Lives as long as the table.
  [[nodiscard]] TilePage* find(std::uint32_t entry, std::uint32_t exit) const {
    return pages_ ? pages_ + (std::uint64_t{entry} << exit_bits_) + exit : nullptr;
  }

  /// All pages, [entry << exit_bits() | exit].
  [[nodiscard]] const TilePage* pages() const { return pages_; }
  [[nodiscard]] int exit_bits() const { return exit_bits_; }

 private:
  PageTable() = default;

  TilePage* pages_ = nullptr;
  int exit_bits_ = 0;
  std::size_t bytes_ = 0;
};

}  // namespace slf
