#include "storage/internal/range_set.h"

#include <algorithm>
#include <functional>

namespace slf::storage::internal {
namespace {

std::vector<FileRange> filled(const std::vector<FileRange>& ascending, std::uint64_t gap) {
  std::vector<FileRange> result;
  for (const FileRange& range : ascending)
    if (!result.empty() && range.begin <= result.back().end + gap)
      result.back().end = std::max(result.back().end, range.end);
    else
      result.push_back(range);
  return result;
}

}  // namespace

void RangeSet::add(FileRange range) {
  if (range.begin >= range.end) return;
  auto at = ranges_.upper_bound(range.begin);
  if (at != ranges_.begin() && std::prev(at)->second >= range.begin) --at;
  while (at != ranges_.end() && at->first <= range.end) {
    range.begin = std::min(range.begin, at->first);
    range.end = std::max(range.end, at->second);
    at = ranges_.erase(at);
  }
  ranges_[range.begin] = range.end;
}

void RangeSet::append_missing(FileRange range, std::vector<FileRange>& to) const {
  auto at = ranges_.upper_bound(range.begin);
  if (at != ranges_.begin() && std::prev(at)->second > range.begin) --at;
  for (; at != ranges_.end() && at->first < range.end; ++at) {
    if (range.begin < at->first) to.push_back({range.begin, at->first});
    range.begin = std::max(range.begin, at->second);
  }
  if (range.begin < range.end) to.push_back(range);
}

bool RangeSet::contains(FileRange range) const {
  std::vector<FileRange> missing;
  append_missing(range, missing);
  return missing.empty();
}

bool RangeSet::intersects(FileRange range) const {
  const auto at = ranges_.lower_bound(range.end);
  return range.begin < range.end && at != ranges_.begin() && std::prev(at)->second > range.begin;
}

std::vector<FileRange> merged(std::vector<FileRange> ranges, std::uint64_t gap,
                              std::size_t max_ranges, std::uint64_t widest) {
  std::sort(ranges.begin(), ranges.end(),
            [](const FileRange& a, const FileRange& b) { return a.begin < b.begin; });
  std::vector<FileRange> result = filled(ranges, gap);
  if (result.size() <= max_ranges) return result;
  std::vector<std::uint64_t> gaps;
  for (std::size_t i = 1; i < result.size(); ++i)
    gaps.push_back(result[i].begin - result[i - 1].end);
  std::nth_element(gaps.begin(), gaps.begin() + static_cast<std::ptrdiff_t>(max_ranges) - 1,
                   gaps.end(), std::greater<>());
  return filled(result, std::min(gaps[max_ranges - 1], widest));
}

}  // namespace slf::storage::internal
