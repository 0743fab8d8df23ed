// TileSelection: some of a field's tiles, by their numbers in key order (TileOrder).
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace slf {

/// A half-open range of tile numbers.
struct NumberRange {
  std::uint64_t begin = 0;
  std::uint64_t end = 0;
  [[nodiscard]] std::uint64_t count() const { return end - begin; }
  /// What of the range is in another one; it may be empty.
  [[nodiscard]] NumberRange within(NumberRange other) const {
    return {std::clamp(begin, other.begin, other.end), std::clamp(end, other.begin, other.end)};
  }
  friend bool operator==(const NumberRange&, const NumberRange&) = default;
};

class TileSelection {
 public:
  /// REQUIRES: the range begins at or after the end of all earlier ones.
  void add(NumberRange range) {
    if (range.begin == range.end) return;
    if (!ranges_.empty() && ranges_.back().end == range.begin) {
      ranges_.back().end = range.end;
    } else {
      ranges_.push_back(range);
      ranks_.push_back(count_);
    }
    count_ += range.count();
  }

  [[nodiscard]] std::uint64_t count() const { return count_; }
  /// Those that are not in another selection.
  [[nodiscard]] TileSelection without(const TileSelection& other) const {
    TileSelection left;
    auto gone = other.ranges_.begin();
    for (NumberRange range : ranges_) {
      for (; gone != other.ranges_.end() && gone->begin < range.end; ++gone) {
        if (gone->begin > range.begin) left.add({range.begin, gone->begin});
        range.begin = std::clamp(gone->end, range.begin, range.end);
        if (gone->end > range.end) break;
      }
      left.add(range);
    }
    return left;
  }
  /// Ascending; between any two there is a gap.
  [[nodiscard]] const std::vector<NumberRange>& ranges() const { return ranges_; }

  /// The k-th number. REQUIRES: k < count().
  [[nodiscard]] std::uint64_t number(std::uint64_t k) const {
    const auto range = std::upper_bound(ranks_.begin(), ranks_.end(), k) - ranks_.begin() - 1;
    return ranges_[static_cast<std::size_t>(range)].begin +
           (k - ranks_[static_cast<std::size_t>(range)]);
  }

  /// How many numbers are below `number`.
  [[nodiscard]] std::uint64_t rank(std::uint64_t number) const {
    const auto before = [](std::uint64_t n, const NumberRange& range) { return n < range.begin; };
    const auto behind = std::upper_bound(ranges_.begin(), ranges_.end(), number, before);
    if (behind == ranges_.begin()) return 0;
    const auto range = behind - ranges_.begin() - 1;
    const NumberRange& at = ranges_[static_cast<std::size_t>(range)];
    return ranks_[static_cast<std::size_t>(range)] + std::min(number, at.end) - at.begin;
  }

  [[nodiscard]] bool has(std::uint64_t number) const {
    const std::uint64_t k = rank(number);
    return k < count_ && this->number(k) == number;
  }

 private:
  std::vector<NumberRange> ranges_;
  std::vector<std::uint64_t> ranks_;  ///< of each range's first number
  std::uint64_t count_ = 0;
};

}  // namespace slf
