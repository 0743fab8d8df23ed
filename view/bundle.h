// Bundle: the scripts of the page as classic scripts, for exported pages.
//
// Browsers load modules only where a page may read other files of its host: not from disk, and not
// in a sandbox. Nor can modules that are inside a page import each other. Classic scripts have no
// such limits.
#pragma once

#include <string>
#include <string_view>

namespace slf::view {

inline constexpr std::string_view kModuleFile = "module.bin";  ///< the WebAssembly module

/// All modules of the page in one script. It begins with `globalThis.slfInside`, an object with the
/// workers' script as a function, `worker`, and `members`, which is empty or more members as
/// JavaScript writes them, such as "size: 1,".
[[nodiscard]] std::string page_script(const std::string& members);

/// The WebAssembly module as a string of JavaScript.
[[nodiscard]] std::string module_string();

/// Bytes as base64.
[[nodiscard]] std::string base64(std::string_view bytes);

}  // namespace slf::view
