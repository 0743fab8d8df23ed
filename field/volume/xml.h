// Reads XML as elements and text, with expat. Entities are refused, so that text cannot expand.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "slf/error.h"

namespace slf::volume_io {

using XmlAttributes = std::map<std::string, std::string, std::less<>>;

struct XmlHandler {
  /// `name` without its prefix. False ends the reading, without an error.
  std::function<bool(std::string_view name, const XmlAttributes& attributes)> start;
  std::function<void(std::string_view name)> end = [](std::string_view) {};
  std::function<void(std::string_view)> text = [](std::string_view) {};
};

/// The largest depth of nested elements.
inline constexpr int kMaxXmlDepth = 64;

/// Parses a file. Returns the offset after the tag at which `start` ended the reading, or the size
/// of the file. bad_file: not well formed, entities, or too deep; the message has the line.
[[nodiscard]] Result<std::uint64_t> read_xml(const std::string& path, const XmlHandler& handler);
/// Parses text in the same way. `source` is its name for messages.
[[nodiscard]] Result<std::uint64_t> parse_xml(std::string_view text, const std::string& source,
                                              const XmlHandler& handler);

}  // namespace slf::volume_io
