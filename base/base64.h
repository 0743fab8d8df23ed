// Base64 (RFC 4648), with either alphabet.
#pragma once

#include <cstddef>
#include <string_view>
#include <vector>

namespace slf {

/// Decodes up to the first character that is neither base64 nor blank, and removes what it read
/// from `text`. Behind padding another sequence may begin. `padded`: an incomplete group of four
/// characters at the end counts for nothing, as text that is cut off leaves it.
[[nodiscard]] inline std::vector<std::byte> decode_base64(std::string_view& text, bool padded) {
  std::vector<std::byte> bytes;
  bytes.reserve(text.size() / 4 * 3);
  unsigned bits = 0, have = 0;  // the lowest `have` of `bits` are not in `bytes` yet
  std::size_t characters = 0, whole = 0;
  for (; !text.empty(); text.remove_prefix(1)) {
    const char c = text.front();
    if (c == ' ' || c == '\t' || c == '\r' || c == '\n') continue;
    const int value = c >= 'A' && c <= 'Z'   ? c - 'A'
                      : c >= 'a' && c <= 'z' ? c - 'a' + 26
                      : c >= '0' && c <= '9' ? c - '0' + 52
                      : c == '+' || c == '-' ? 62
                      : c == '/' || c == '_' ? 63
                                             : -1;
    if (value < 0 && c != '=') break;
    if (c == '=') {
      have = 0;
    } else {
      bits = bits << 6 | static_cast<unsigned>(value);
      have += 6;
    }
    if (have >= 8) {
      have -= 8;
      bytes.push_back(static_cast<std::byte>(bits >> have & 0xff));
    }
    if (++characters % 4 == 0) whole = bytes.size();
  }
  if (padded) bytes.resize(whole);
  return bytes;
}

}  // namespace slf
