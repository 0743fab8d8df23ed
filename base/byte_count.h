// Numbers of bytes as people write them.
#pragma once

#include <charconv>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/ascii.h"

namespace slf {

/// "4096", "64MiB" or "1.5g" as a number of bytes; nothing if it is none, or 2^63 or more.
[[nodiscard]] inline std::optional<std::uint64_t> parse_byte_count(std::string_view text) {
  double number = 0;
  text = trim(text);
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), number);
  const std::string unit = lower_case(trim({parsed.ptr, text.data() + text.size()}));
  const std::size_t power = unit.empty() ? 0 : std::string_view("bkmgt").find(unit[0]);
  if (parsed.ec != std::errc() || power == std::string_view::npos) return {};
  const std::string rest = unit.empty() ? "" : unit.substr(1);
  if (!rest.empty() && (power == 0 || (rest != "b" && rest != "ib"))) return {};
  const double bytes = std::ldexp(number, static_cast<int>(10 * power));
  return bytes >= 0 && bytes < 0x1p63 ? std::optional(static_cast<std::uint64_t>(bytes))
                                      : std::nullopt;
}

}  // namespace slf
