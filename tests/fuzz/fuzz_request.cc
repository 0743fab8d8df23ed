// Any bytes as a request to the server of the page: none, or one that other readers of HTTP see as
// the same. Names and values have no character that would end them, and each came from one line.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "page/http.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t length) {
  const std::string_view head(reinterpret_cast<const char*>(data), length);
  const auto request = slf::page::parse_request(head);
  if (!request) return 0;
  const auto has = [](std::string_view text, std::string_view any) {
    return text.find_first_of(any) != std::string_view::npos;
  };
  constexpr std::string_view kBreaks("\r\n\0", 3);
  if (has(request->method, " \t") || has(request->path, " ?")) std::abort();
  if (has(request->method, kBreaks) || has(request->path, kBreaks)) std::abort();
  std::size_t lines = 0;
  for (std::size_t at = 0; (at = head.find("\r\n", at)) != head.npos; at += 2) ++lines;
  if (request->headers.size() > lines) std::abort();
  for (const auto& [name, value] : request->headers) {
    if (name.empty() || has(name, " \t:") || has(name, kBreaks) || has(value, kBreaks))
      std::abort();
    if (request->count(name) == 0 || head.find(value) == head.npos) std::abort();
  }
  return 0;
}
