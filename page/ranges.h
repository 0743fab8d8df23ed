// The header Range of HTTP (RFC 9110, 14.2): which parts of a file a request asks for.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

namespace slf::page {

/// A part of a file, of one byte at least.
struct FilePart {
  std::uint64_t first = 0;
  std::uint64_t size = 0;
};

inline constexpr std::size_t kMaxRanges = 200;  ///< of one request

/// The parts of a file of `size` bytes that an untrusted header selects, in its order; ranges
/// beyond the end are left out. Nothing stands for the whole file: if the header is empty or
/// malformed, names more than kMaxRanges ranges, or asks for more bytes than the file has. No
/// parts: all ranges are beyond the end.
[[nodiscard]] std::optional<std::vector<FilePart>> select_ranges(std::string_view header,
                                                                 std::uint64_t size);

}  // namespace slf::page
