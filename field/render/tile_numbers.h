// TileNumbers: small consecutive numbers for the tiles that rays meet. Private to field/.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

namespace slf {

inline constexpr std::uint32_t kNoTile = ~0u;

/// Numbers pairs of sections in the order they are first asked for. Thread-safety: one thread.
class TileNumbers {
 public:
  struct Pair {
    std::uint32_t entry = 0, exit = 0;  ///< section indices
    friend bool operator==(const Pair&, const Pair&) = default;
  };

  TileNumbers() { clear(); }

  /// The numbers last asked for, for the kernel to look up many at a time: a pair is in its slot,
  /// or must be asked for.
  struct Recent {
    static constexpr std::uint32_t kSlots = 512;
    /// Of two products, the highest bits.
    static constexpr std::uint32_t kEntryFactor = 0x9E3779B1, kExitFactor = 0x85EBCA77;
    static constexpr int kShift = 23;

    std::array<std::uint32_t, kSlots> entry, exit, number;
  };
  static_assert(Recent::kSlots == 1u << (32 - Recent::kShift));

  /// Not inlined: the kernel rarely needs it, and its loop keeps its registers.
  [[nodiscard, gnu::noinline]] std::uint32_t number(Pair pair) {
    std::uint32_t number = known(pair);
    if (number == kNoTile) number = add(pair);
    const std::uint32_t at =
        (pair.entry * Recent::kEntryFactor + pair.exit * Recent::kExitFactor) >> Recent::kShift;
    recent_.entry[at] = pair.entry, recent_.exit[at] = pair.exit, recent_.number[at] = number;
    return number;
  }
  [[nodiscard]] const Recent& recent() const { return recent_; }
  /// The number a pair was given, or kNoTile.
  [[nodiscard]] std::uint32_t known(Pair pair) const { return slots_[slot_of(pair)].number; }

  [[nodiscard]] const std::vector<Pair>& pairs() const { return pairs_; }

  void clear() {
    pairs_.clear();
    slots_.assign(std::max<std::size_t>(slots_.size(), 256), {});
    recent_.entry.fill(kNoTile);
  }

 private:
  struct alignas(16) Slot {
    Pair pair;
    std::uint32_t number = kNoTile;  // none: free
  };

  /// The slot of a pair, or the free one where it would go.
  [[nodiscard]] std::size_t slot_of(Pair pair) const {
    const std::uint64_t key = std::uint64_t{pair.entry} << 32 | pair.exit;
    std::size_t slot = key * 0x9E3779B97F4A7C15u >> 32 & (slots_.size() - 1);
    while (slots_[slot].number != kNoTile && slots_[slot].pair != pair)
      slot = (slot + 1) & (slots_.size() - 1);
    return slot;
  }

  std::uint32_t add(Pair pair) {
    if (2 * pairs_.size() >= slots_.size()) {  // at most half full
      slots_.assign(4 * slots_.size(), {});
      for (std::uint32_t n = 0; n < pairs_.size(); ++n) slots_[slot_of(pairs_[n])] = {pairs_[n], n};
    }
    const auto number = static_cast<std::uint32_t>(pairs_.size());
    slots_[slot_of(pair)] = {pair, number};
    pairs_.push_back(pair);
    return number;
  }

  std::vector<Pair> pairs_;
  std::vector<Slot> slots_;  // open addressing
  Recent recent_;
};

}  // namespace slf
