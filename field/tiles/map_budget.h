// MapBudget: about how many bytes of the map are resident because a cache read them.
//
// Linux maps 64 KiB around a page that is read. Over budget, the whole map is to be released: pages
// that are still in use fault back in.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

#include "storage/tile_store.h"

namespace slf {

/// For one thread at a time.
class MapBudget {
 public:
  explicit MapBudget(std::uint64_t bytes) : budget_(bytes) {}

  [[nodiscard]] bool limited() const { return budget_ != ~std::uint64_t{0}; }
  /// The records whose tables can be read at a time: at least one.
  [[nodiscard]] std::uint64_t records() const {
    return std::max<std::uint64_t>(budget_ / (4 * kWindow), 1);
  }

  /// Finding a tile maps two windows: its record's table and a leaf of the tree.
  void count_find() { count(2); }
  /// A payload next to the one read last shares these.
  void count_read(const storage::FileRange& payload) {
    if (payload.begin >= payload.end) return count_find();
    const std::uint64_t first = payload.begin / kWindow, last = (payload.end - 1) / kWindow;
    count(last - first + (first == std::exchange(last_, last) ? 0 : 3));
  }
  /// Whether the map must be released. If so, it counts as released.
  [[nodiscard]] bool take_due() { return std::exchange(due_, false); }

 private:
  static constexpr std::uint64_t kWindow = 1 << 16, kNone = ~std::uint64_t{0};
  static constexpr std::uint64_t kTree = 3;  // windows, about, on the way through the tree

  void count(std::uint64_t windows) {
    used_ += windows * kWindow;
    if (used_ <= budget_) return;
    due_ = true;
    used_ = kTree * kWindow;  // the tree's pages are soon read again
    last_ = kNone;
  }

  const std::uint64_t budget_;
  std::uint64_t used_ = 0;  // since the last release
  std::uint64_t last_ = 0;  // the window that was read last
  bool due_ = false;
};

}  // namespace slf
