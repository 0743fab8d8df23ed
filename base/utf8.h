// Untrusted text: which bytes of it can be shown.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

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
