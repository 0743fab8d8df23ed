// PageTable: finds the loaded tiles of one level by their sections, without a lock.
//
// A page is a tile here, not 4 KiB of a file: the name is that of virtual texturing. As there, an
// entry section and an exit section index the table directly, so one load finds a tile. Readers
// look tiles up while the cache loads and removes others: the samples of a removed tile stay valid
// until every reader that may have found them has left its ReadScope (tile_cache.h).
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>

namespace slf {

/// Zeros that stand for the samples of an empty tile, as many as one load can reach. The addresses
/// of all tiles' samples are stored relative to these.
inline constexpr std::size_t kZeroReach = 16;  // bytes that are 0 before and after
alignas(64) inline constexpr std::array<std::byte, 2 * kZeroReach> kZeroSamples{};
[[nodiscard]] inline const std::byte* zero_samples() { return kZeroSamples.data() + kZeroReach; }
/// The offset in bytes from zero_samples() to the first sample of a tile; 0 for null.
[[nodiscard]] inline std::int64_t sample_offset(const std::byte* first) {
  if (!first) return 0;
  return static_cast<std::int64_t>(reinterpret_cast<std::uintptr_t>(first) -
                                   reinterpret_cast<std::uintptr_t>(zero_samples()));
}

/// An entry of the table: a tile, as readers find it. The cache writes `state` last, so a reader
/// that finds it loaded finds its samples.
struct alignas(32) TilePage {
  static constexpr std::uint32_t kLoaded = 1;   ///< samples are loaded, or known to be zeros
  static constexpr std::uint32_t kMissing = 2;  ///< never built

  static constexpr int kStampBits = 16;  // offsets between user addresses take 48 bits
  static constexpr std::uint64_t kStampMask = (1 << kStampBits) - 1;
  /// Instead of stamps: kNotFound if no frame has found the tile yet, kRemoved after its removal.
  static constexpr std::uint64_t kNotFound = 0, kRemoved = kStampMask;
  static constexpr std::uint32_t kStamps = 0xFFFE;  ///< frames until a stamp is reused

  /// The stamp of a frame.
  [[nodiscard]] static constexpr std::uint64_t stamp(std::uint32_t frame) {
    return 1 + std::uint64_t{frame % kStamps};
  }
  [[nodiscard]] static constexpr std::uint64_t found_word(std::int64_t offset,
                                                          std::uint64_t stamp) {
    return static_cast<std::uint64_t>(offset) << kStampBits | stamp;
  }

  /// The first colour and the first depth; null if the tile is empty, or has no depths.
  std::atomic<const std::byte*> color{nullptr}, depth{nullptr};
  /// The word that kernels load: the sample_offset() of the colours, above the stamp of a frame
  /// that found the tile loaded and complete; or kNotFound or kRemoved. A new stamp is stored
  /// only if the word has not changed meanwhile, so never into the word of another tile.
  std::atomic<std::uint64_t> found{0};
  std::atomic<std::uint32_t> state{0};  ///< kLoaded and other flags; 0: not loaded
  /// The frame that used it last, which orders removals. `found` has its stamp, too, unless the
  /// tile is missing.
  std::atomic<std::uint32_t> used{0};
};
static_assert(sizeof(TilePage) == 32);

/// Thread-safety: any thread.
class PageTable {
 public:
  /// A table for a level with these numbers of sections. Memory is used only for pages that are
  /// written. The table is empty if there is not enough address space. REQUIRES: exit_sections is a
  /// power of two.
  [[nodiscard]] static PageTable make(std::uint64_t entry_sections, std::uint64_t exit_sections);
  PageTable() = default;  ///< empty

  /// Whether the table is not empty.
  explicit operator bool() const { return pages_ != nullptr; }

  /// The page of a tile; null in an empty table. Lives as long as the table.
  [[nodiscard]] TilePage* find(std::uint32_t entry, std::uint32_t exit) const {
    return pages_ ? pages() + (std::uint64_t{entry} << exit_bits_) + exit : nullptr;
  }

  /// All pages, [entry << exit_bits() | exit].
  [[nodiscard]] TilePage* pages() const { return pages_.get(); }
  [[nodiscard]] int exit_bits() const { return exit_bits_; }

 private:
  struct Unmap {
    std::size_t bytes;
    void operator()(TilePage* pages) const;
  };
  std::unique_ptr<TilePage, Unmap> pages_;
  int exit_bits_ = 0;
};

}  // namespace slf
