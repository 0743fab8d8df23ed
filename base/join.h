// Lists as texts, for messages and notes. Internal.
#pragma once

#include <algorithm>
#include <functional>
#include <string>
#include <string_view>

#include "slf/error.h"

namespace slf {

/// The items of a range, or what `to_text` makes of each, with a separator between them.
template <class Range, class ToText = std::identity>
[[nodiscard]] std::string joined(const Range& items, std::string_view separator = ", ",
                                 const ToText& to_text = {}) {
  std::string text;
  std::string_view before;
  for (const auto& item : items) {
    text += concat(before, std::invoke(to_text, item));
    before = separator;
  }
  return text;
}

/// The text in lines of at most `width` columns. The first begins at `column`, the others with
/// `indent`.
[[nodiscard]] inline std::string filled(std::string_view text, std::size_t width,
                                        std::size_t column = 0, std::string_view indent = "") {
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    if (!out.empty() && column + 1 + end - at > width) {
      out.append("\n").append(indent);
      column = indent.size();
    } else if (!out.empty()) {
      out += ' ';
      ++column;
    }
    out += text.substr(at, end - at);
    column += end - at;
    at = end + 1;
  }
  return out;
}

}  // namespace slf
