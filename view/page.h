// The files of the page that shows a field. The program has them inside; the build puts them there.
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

/// Why there is no page, as a sentence with the cure.
[[nodiscard]] std::string no_page();

}  // namespace slf::view
