// Integers of variable length, LEB128: seven bits per byte, least significant first; bit 7 is set
// in every byte but the last.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "base/bytes.h"

namespace slf {

/// The number of bytes that append_varint() appends: 1 to 10.
[[nodiscard]] constexpr std::size_t varint_bytes(std::uint64_t value) {
  std::size_t bytes = 1;
  for (; value >= 0x80; value >>= 7) ++bytes;
  return bytes;
}

inline void append_varint(Bytes& to, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) to.push_back(static_cast<std::byte>(value | 0x80));
  to.push_back(static_cast<std::byte>(value));
}

/// Reads an integer at the start of `from` and drops its bytes from there. Null, with `from`
/// unchanged, if the integer is not complete, exceeds 64 bits, or does not use the fewest bytes
/// possible. Safe for untrusted input.
[[nodiscard]] inline std::optional<std::uint64_t> take_varint(ByteSpan& from) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const auto byte = std::to_integer<std::uint64_t>(from[i]);
    if (i == 9 && byte > 1) return std::nullopt;  // 63 bits are read: only one more fits
    value |= (byte & 0x7F) << (7 * i);
    if (byte >= 0x80) continue;
    if (byte == 0 && i > 0) return std::nullopt;
    from = from.subspan(i + 1);
    return value;
  }
  return std::nullopt;
}

}  // namespace slf
