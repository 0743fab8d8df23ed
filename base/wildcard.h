// Patterns of names, as shells have them.
#pragma once

#include <optional>
#include <string_view>
#include <tuple>
#include <utility>

#include "base/utf8.h"

namespace slf {

/// Removes the first character of `text` and returns it. REQUIRES: not empty.
inline std::string_view take_character(std::string_view& text) {
  const std::size_t length = utf8_length(text);
  const std::string_view character = text.substr(0, length == 0 ? 1 : length);
  text.remove_prefix(character.size());
  return character;
}

/// Whether a character is in the set that `pattern` begins with, after its '[': characters, ranges
/// such as a-z, in UTF-8's order; all others after '!' or '^'. Removes the set. nullopt: it has no
/// end.
inline std::optional<bool> take_set(std::string_view& pattern, std::string_view character) {
  std::string_view rest = pattern;
  const auto member = [&] {
    const std::string_view one = take_character(rest);
    return one == "\\" && !rest.empty() ? take_character(rest) : one;
  };
  const bool others = rest.starts_with('!') || rest.starts_with('^');
  if (others) rest.remove_prefix(1);
  bool found = false;
  for (bool first = true; !rest.empty(); first = false) {
    if (rest.starts_with(']') && !first) {
      pattern = rest.substr(1);
      return found != others;
    }
    const std::string_view low = member();
    const bool is_range = rest.size() > 1 && rest[0] == '-' && rest[1] != ']';
    if (is_range) rest.remove_prefix(1);
    found |= low <= character && character <= (is_range ? member() : low);
  }
  return std::nullopt;
}

/// Whether `name` fits `pattern`: * stands for any characters, ? for one, [a-z] and [!a-z] for one
/// of a set; \ takes the next character as it is. Both are UTF-8. Untrusted input is safe: only the
/// last * is ever moved, so the time grows with the product of the lengths.
[[nodiscard]] inline bool fits_pattern(std::string_view pattern, std::string_view name) {
  const auto fits_one = [](std::string_view& rest, std::string_view character) {
    const std::string_view first = take_character(rest);
    if (first == "?") return true;
    if (first == "\\") return !rest.empty() && take_character(rest) == character;
    if (first == "[")
      if (const auto is_in = take_set(rest, character)) return *is_in;
    return first == character;
  };
  std::optional<std::pair<std::string_view, std::string_view>> star;  // what follows it in both
  for (;;) {
    if (pattern.starts_with('*')) {
      pattern.remove_prefix(1);
      star.emplace(pattern, name);
      continue;
    }
    if (name.empty()) return pattern.empty();
    std::string_view later = pattern, rest = name;
    if (!pattern.empty() && fits_one(later, take_character(rest))) {
      pattern = later;
      name = rest;
      continue;
    }
    if (!star) return false;
    take_character(star->second);
    std::tie(pattern, name) = *star;
  }
}

}  // namespace slf
