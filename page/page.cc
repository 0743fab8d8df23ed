#include "page/page.h"

#include <algorithm>
#include <vector>

// The assembler includes the files unchanged. SLF_PAGE_FILES, which CMake writes, has a line
// PAGE_FILE(SYMBOL, NAME, PATH) for each of them; it is not defined if there is no page.
#ifdef SLF_PAGE_FILES
#define PAGE_FILE(symbol, name, path)                                                          \
  asm(".section .rodata\nslf_page_" #symbol "_begin:\n.incbin \"" path "\"\nslf_page_" #symbol \
      "_end:\n.byte 0\n.previous\n");                                                          \
  extern "C" {                                                                                 \
  __attribute__((visibility("hidden"))) extern const char slf_page_##symbol##_begin[];         \
  __attribute__((visibility("hidden"))) extern const char slf_page_##symbol##_end[];           \
  }
#include SLF_PAGE_FILES
#undef PAGE_FILE
#endif

namespace slf::page {

namespace {
constexpr std::size_t kStudioFiles = 3;  // the last ones

std::span<const PageFile> all_files() {
#ifdef SLF_PAGE_FILES
  const auto file = [](std::string_view name, const char* begin, const char* end) {
    const std::string_view type = name.ends_with(".html")  ? "text/html; charset=utf-8"
                                  : name.ends_with(".css") ? "text/css; charset=utf-8"
                                  : name.ends_with(".js")  ? "text/javascript; charset=utf-8"
                                                           : "application/octet-stream";
    return PageFile{name, type, {begin, static_cast<std::size_t>(end - begin)}};
  };
#define PAGE_FILE(symbol, name, path) \
  file(name, slf_page_##symbol##_begin, slf_page_##symbol##_end),
  static const std::vector<PageFile> files = {
#include SLF_PAGE_FILES
  };
  return files;
#else
  return {};
#endif
}
}  // namespace

std::span<const PageFile> page_files() {
  const auto all = all_files();
  return all.first(all.size() - std::min(all.size(), kStudioFiles));
}
std::span<const PageFile> studio_files() { return all_files().subspan(page_files().size()); }

std::string no_page() {
  return "this slf was built without the page that shows fields, because clang could not make "
         "WebAssembly or esbuild was missing; run scripts/install-packages and build again";
}

}  // namespace slf::page
