// TileNumbers: small consecutive numbers for the tiles that rays meet. Private to field/.
#pragma once

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

  TileNumbers() : slots_(256) {}

  [[nodiscard]] std::uint32_t number(Pair pair) {
    const Slot& slot = find(pair);
    return slot.number != kNoTile ? slot.number : add(pair);
  }

  [[nodiscard]] const std::vector<Pair>& pairs() const { return pairs_; }

  void clear() {
    pairs_.clear();
    slots_.assign(slots_.size(), {});
  }

 private:
  struct alignas(16) Slot {
    Pair pair;
    std::uint32_t number = kNoTile;  // none: free
  };

  /// The slot of a pair, or the free one where it would go.
  [[nodiscard]] Slot& find(Pair pair) {
    const std::uint64_t key = std::uint64_t{pair.entry} << 32 | pair.exit;
    std::size_t slot = key * 0x9E3779B97F4A7C15u >> 32 & (slots_.size() - 1);
    while (slots_[slot].number != kNoTile && slots_[slot].pair != pair)
      slot = (slot + 1) & (slots_.size() - 1);
    return slots_[slot];
  }

  std::uint32_t add(Pair pair) {
    if (2 * pairs_.size() >= slots_.size()) {  // at most half full
      slots_.assign(4 * slots_.size(), {});
      for (std::uint32_t n = 0; n < pairs_.size(); ++n) find(pairs_[n]) = {pairs_[n], n};
    }
    const auto number = static_cast<std::uint32_t>(pairs_.size());
    find(pair) = {pair, number};
    pairs_.push_back(pair);
    return number;
  }

  std::vector<Pair> pairs_;
  std::vector<Slot> slots_;  // open addressing
};

}  // namespace slf
