// limit_nesting: a bound of how deep JSON is nested.
#pragma once

#include <nlohmann/json.hpp>
#include <stdexcept>

namespace slf {

/// For nlohmann::json::parse(). Throws std::length_error where JSON is nested deeper than 64:
/// copying and printing it is recursive, and the stack is finite.
inline bool limit_nesting(int depth, nlohmann::json::parse_event_t /*event*/,
                          nlohmann::json& /*value*/) {
  if (depth > 64) throw std::length_error("nested deeper than 64");
  return true;
}

}  // namespace slf
