// The files of the page that shows a field. The build embeds them in the program.
#pragma once

#include <span>
#include <string>
#include <string_view>

namespace slf::page {

struct PageFile {
  std::string_view name;  ///< "index.html", "page.js", …
  std::string_view type;  ///< the media type
  std::string_view bytes;
};

/// All files of the page, index.html first. The list is empty if slf was built without the page,
/// for lack of tools for WebAssembly or of esbuild.
[[nodiscard]] std::span<const PageFile> page_files();

/// Those of the studio, which exported pages do not have: studio.html, studio.css, studio.js.
[[nodiscard]] std::span<const PageFile> studio_files();

/// The error message of a program without a page: the reason, and what to do.
[[nodiscard]] std::string no_page();

}  // namespace slf::page
