// Lower case of ASCII, for names of files and words of their formats.
#pragma once

#include <string>

namespace slf {

[[nodiscard]] inline std::string lower_case(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

}  // namespace slf
