// Texts of several parts, for messages and notes. Internal.
#pragma once

#include <functional>
#include <sstream>
#include <string>
#include <string_view>

namespace slf {

/// The streamable parts as one text, as fail() makes its message of them.
template <class... Parts>
[[nodiscard]] std::string concat(const Parts&... parts) {
  std::ostringstream text;
  (text << ... << parts);
  return std::move(text).str();
}

/// The items of a range, or what `to_text` makes of each, with a separator between them.
template <class Range, class ToText = std::identity>
[[nodiscard]] std::string joined(const Range& items, std::string_view separator = ", ",
                                 const ToText& to_text = {}) {
  std::ostringstream text;
  std::string_view before;
  for (const auto& item : items) {
    text << before << std::invoke(to_text, item);
    before = separator;
  }
  return std::move(text).str();
}

}  // namespace slf
