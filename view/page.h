// The files of the page that shows a field. The build embeds them in the program.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace slf::view {

struct PageFile {
  std::string_view name;  ///< "index.html", "main.js", …
  std::string_view type;  ///< the media type
  std::string_view bytes;
};

/// All files; index.html is the first. Without tools for WebAssembly, slf is built without the
/// page, and the list is empty.
[[nodiscard]] std::span<const PageFile> page_files();

/// An error message for programs without a page: the reason and the cure.
[[nodiscard]] std::string no_page();

}  // namespace slf::view
