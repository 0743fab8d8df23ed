// Untrusted text: which bytes of it can be shown.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "base/ascii.h"

namespace slf {

/// The length of the UTF-8 sequence at the start of `text`; 0 if there is no valid one. Surrogates,
/// overlong forms and code points above U+10FFFF are invalid. REQUIRES: not empty.
[[nodiscard]] inline std::size_t utf8_length(std::string_view text) {
  const auto byte = [&](std::size_t k) { return static_cast<unsigned char>(text[k]); };
  const unsigned first = byte(0);
  if (first < 0x80) return 1;
  const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4 || text.size() < length) return 0;
  for (std::size_t k = 1; k < length; ++k)
    if (byte(k) >> 6 != 2) return 0;
  const unsigned two = first << 8 | byte(1);
  const bool bad = (two >= 0xE080 && two < 0xE0A0) || (two >= 0xEDA0 && two < 0xEE80) ||
                   (two >= 0xF080 && two < 0xF090) || two >= 0xF490;
  return bad ? 0 : length;
}

/// Appends a code point.
inline void append_utf8(std::uint32_t code, std::string& text) {
  const auto tail = [&](unsigned shift) { return static_cast<char>(0x80 | (code >> shift & 63)); };
  if (code < 0x80)
    text += static_cast<char>(code);
  else if (code < 0x800)
    text += {static_cast<char>(0xC0 | code >> 6), tail(0)};
  else if (code < 0x10000)
    text += {static_cast<char>(0xE0 | code >> 12), tail(6), tail(0)};
  else
    text += {static_cast<char>(0xF0 | code >> 18), tail(12), tail(6), tail(0)};
}

/// A file of text without its byte-order mark: UTF-16, if the mark says so, UTF-8, or else Latin-1.
/// What is not UTF-8 is converted into `made`, which must live as long as the result.
inline std::string_view as_utf8(std::string_view bytes, std::string& made) {
  const bool big = bytes.starts_with("\xFE\xFF"), wide = big || bytes.starts_with("\xFF\xFE");
  bytes = without_byte_order_mark(bytes);
  std::string_view rest = bytes;
  for (std::size_t n = 1; n > 0 && !rest.empty(); rest.remove_prefix(n)) n = utf8_length(rest);
  if (rest.empty()) return bytes;
  const auto byte = [&](std::size_t k) { return static_cast<unsigned char>(bytes[k]); };
  const auto unit = [&](std::size_t k) -> std::uint32_t {
    return k + 1 < bytes.size() ? byte(k + (big ? 0 : 1)) << 8U | byte(k + (big ? 1 : 0)) : 0;
  };
  for (std::size_t k = wide ? 2 : 0; k < bytes.size(); k += wide ? 2 : 1) {
    std::uint32_t code = wide ? unit(k) : byte(k);
    if (wide && code >> 10 == 0x36 && unit(k + 2) >> 10 == 0x37) {
      code = 0x10000 + ((code & 1023U) << 10U | (unit(k + 2) & 1023U));
      k += 2;
    }
    append_utf8(code, made);
  }
  return made;
}

/// Control characters: C0 except line feeds and tabs, DEL, and C1.
[[nodiscard]] inline bool is_control(std::string_view character) {
  const auto first = static_cast<unsigned char>(character[0]);
  if (character.size() == 1)
    return (first < 0x20 && first != '\n' && first != '\t') || first == 0x7F;
  return first == 0xC2 && static_cast<unsigned char>(character[1]) < 0xA0;
}

/// "\x93\x00".
[[nodiscard]] inline std::string escaped(std::string_view bytes) {
  std::string text;
  for (const char c : bytes) {
    const auto byte = static_cast<unsigned char>(c);
    text += {'\\', 'x', "0123456789abcdef"[byte >> 4], "0123456789abcdef"[byte & 15]};
  }
  return text;
}

}  // namespace slf
