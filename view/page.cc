#include "view/page.h"

#include <array>

// The assembler includes the files unchanged. SLF_WASM_FILE is defined if there is a page.
#ifdef SLF_WASM_FILE
#define SLF_EMBED(symbol, file)                                              \
  asm(".section .rodata\n" #symbol "_begin:\n.incbin \"" file "\"\n" #symbol \
      "_end:\n.byte 0\n.previous\n");                                        \
  extern "C" {                                                               \
  __attribute__((visibility("hidden"))) extern const char symbol##_begin[];  \
  __attribute__((visibility("hidden"))) extern const char symbol##_end[];    \
  }

SLF_EMBED(slf_page_index, SLF_PAGE_DIR "/index.html")
SLF_EMBED(slf_page_style, SLF_PAGE_DIR "/style.css")
SLF_EMBED(slf_page_shader, SLF_PAGE_DIR "/shader.js")
SLF_EMBED(slf_page_module, SLF_PAGE_DIR "/module.js")
SLF_EMBED(slf_page_camera, SLF_PAGE_DIR "/camera.js")
SLF_EMBED(slf_page_viewer, SLF_PAGE_DIR "/viewer.js")
SLF_EMBED(slf_page_explain, SLF_PAGE_DIR "/explain.js")
SLF_EMBED(slf_page_look, SLF_PAGE_DIR "/look.js")
SLF_EMBED(slf_page_controls, SLF_PAGE_DIR "/controls.js")
SLF_EMBED(slf_page_renderer, SLF_PAGE_DIR "/renderer.js")
SLF_EMBED(slf_page_source, SLF_PAGE_DIR "/source.js")
SLF_EMBED(slf_page_field, SLF_PAGE_DIR "/field.js")
SLF_EMBED(slf_page_cache, SLF_PAGE_DIR "/cache.js")
SLF_EMBED(slf_page_decoders, SLF_PAGE_DIR "/decoders.js")
SLF_EMBED(slf_page_reader, SLF_PAGE_DIR "/reader.js")
SLF_EMBED(slf_page_loader, SLF_PAGE_DIR "/loader.js")
SLF_EMBED(slf_page_main, SLF_PAGE_DIR "/main.js")
SLF_EMBED(slf_page_worker, SLF_PAGE_DIR "/worker.js")
SLF_EMBED(slf_page_wasm, SLF_WASM_FILE)
#endif

namespace slf::view {

std::span<const PageFile> page_files() {
#ifdef SLF_WASM_FILE
  constexpr std::string_view kScript = "text/javascript; charset=utf-8";
  const auto file = [](std::string_view name, std::string_view type, const char* begin,
                       const char* end) {
    return PageFile{name, type, {begin, static_cast<std::size_t>(end - begin)}};
  };
  // Each script comes after those that it imports.
  static const std::array files = {
      file("index.html", "text/html; charset=utf-8", slf_page_index_begin, slf_page_index_end),
      file("style.css", "text/css; charset=utf-8", slf_page_style_begin, slf_page_style_end),
      file("shader.js", kScript, slf_page_shader_begin, slf_page_shader_end),
      file("module.js", kScript, slf_page_module_begin, slf_page_module_end),
      file("camera.js", kScript, slf_page_camera_begin, slf_page_camera_end),
      file("renderer.js", kScript, slf_page_renderer_begin, slf_page_renderer_end),
      file("source.js", kScript, slf_page_source_begin, slf_page_source_end),
      file("field.js", kScript, slf_page_field_begin, slf_page_field_end),
      file("cache.js", kScript, slf_page_cache_begin, slf_page_cache_end),
      file("decoders.js", kScript, slf_page_decoders_begin, slf_page_decoders_end),
      file("reader.js", kScript, slf_page_reader_begin, slf_page_reader_end),
      file("loader.js", kScript, slf_page_loader_begin, slf_page_loader_end),
      file("viewer.js", kScript, slf_page_viewer_begin, slf_page_viewer_end),
      file("controls.js", kScript, slf_page_controls_begin, slf_page_controls_end),
      file("explain.js", kScript, slf_page_explain_begin, slf_page_explain_end),
      file("look.js", kScript, slf_page_look_begin, slf_page_look_end),
      file("main.js", kScript, slf_page_main_begin, slf_page_main_end),
      file("worker.js", kScript, slf_page_worker_begin, slf_page_worker_end),
      file("module.bin", "application/octet-stream", slf_page_wasm_begin, slf_page_wasm_end)};
  return files;
#else
  return {};
#endif
}

std::string no_page() {
  return "this slf was built without the page that shows fields, because clang could not make "
         "WebAssembly; run scripts/install-packages and build again";
}

}  // namespace slf::view
