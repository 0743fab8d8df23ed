// XML as elements and text, by expat. Entities are refused, so that no text grows as it is read.
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

/// Text of at most this depth.
inline constexpr int kDeepestXml = 64;

/// The file from its start. Returns the byte behind the element at which `start` ended it, or the
/// size of the file. bad_file: not well formed, entities, too deep; with line.
[[nodiscard]] Result<std::uint64_t> read_xml(const std::string& path, const XmlHandler& handler);
/// The same of text; `source` is its name for messages.
[[nodiscard]] Result<std::uint64_t> parse_xml(std::string_view text, const std::string& source,
                                              const XmlHandler& handler);

}  // namespace slf::volume_io
