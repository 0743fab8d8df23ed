// Base64 (RFC 4648), with either alphabet.
#pragma once

#include <cstddef>
#include <string_view>
#include <vector>

namespace slf {

/// Decodes up to the first character that is neither base64 nor blank, and removes what it read
/// from `text`. Padding may be left out; behind it another sequence may begin.
[[nodiscard]] inline std::vector<std::byte> decode_base64(std::string_view& text) {
  std::vector<std::byte> bytes;
  bytes.reserve(text.size() / 4 * 3);
  unsigned bits = 0, have = 0;  // the lowest `have` of `bits` are not in `bytes` yet
  for (; !text.empty(); text.remove_prefix(1)) {
    const char c = text.front();
    if (c == '=') have = 0;
    if (c == '=' || c == ' ' || c == '\t' || c == '\r' || c == '\n') continue;
    const int value = c >= 'A' && c <= 'Z'   ? c - 'A'
                      : c >= 'a' && c <= 'z' ? c - 'a' + 26
                      : c >= '0' && c <= '9' ? c - '0' + 52
                      : c == '+' || c == '-' ? 62
                      : c == '/' || c == '_' ? 63
                                             : -1;
    if (value < 0) break;
    bits = bits << 6 | static_cast<unsigned>(value);
    have += 6;
    if (have < 8) continue;
    have -= 8;
    bytes.push_back(static_cast<std::byte>(bits >> have & 0xff));
  }
  return bytes;
}

}  // namespace slf
