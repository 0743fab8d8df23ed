#include "page/ranges.h"

#include <algorithm>

#include "base/ascii.h"

namespace slf::page {
namespace {

/// Parses one range and appends it to `parts`, unless it is beyond the end of the file. False: the
/// range is malformed.
bool add_range(std::string_view text, std::uint64_t size, std::vector<FilePart>& parts) {
  while (text.starts_with(' ')) text.remove_prefix(1);
  const std::size_t dash = text.find('-');
  if (dash == std::string_view::npos) return false;
  const std::string_view first = text.substr(0, dash), last = text.substr(dash + 1);
  const auto from = parse_number<std::uint64_t>(first), to = parse_number<std::uint64_t>(last);
  if ((!from && !first.empty()) || (!to && !last.empty()) || (!from && !to)) return false;
  if (from && to && *to < *from) return false;
  const std::uint64_t begin = from ? *from : size - std::min(size, *to);
  const std::uint64_t end = from && to && *to < size ? *to + 1 : size;
  if (begin < end) parts.push_back({begin, end - begin});
  return true;
}

}  // namespace

std::optional<std::vector<FilePart>> select_ranges(std::string_view header, std::uint64_t size) {
  constexpr std::string_view kUnit = "bytes=";
  if (!header.starts_with(kUnit)) return std::nullopt;
  header.remove_prefix(kUnit.size());
  std::vector<FilePart> parts;
  std::uint64_t left = size;
  for (std::size_t count = 1;; ++count) {
    const std::size_t comma = header.find(','), before = parts.size();
    if (count > kMaxRanges || !add_range(header.substr(0, comma), size, parts)) return std::nullopt;
    if (parts.size() > before) {
      if (parts.back().size > left) return std::nullopt;
      left -= parts.back().size;
    }
    if (comma == std::string_view::npos) return parts;
    header.remove_prefix(comma + 1);
  }
}

}  // namespace slf::page
