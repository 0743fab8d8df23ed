// Any bytes as a header Range and a file's size: the whole file, or parts within it that together
// are not longer, and that a header made of them selects again.
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>

#include "page/ranges.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t length) {
  using namespace slf::page;
  std::uint64_t size = 0;
  if (length < sizeof size) return 0;
  std::memcpy(&size, data, sizeof size);
  const std::string header(reinterpret_cast<const char*>(data) + sizeof size, length - sizeof size);
  const auto parts = select_ranges(header, size);
  if (!parts) return 0;
  if (parts->size() > kMaxRanges) std::abort();
  std::uint64_t left = size;
  std::string again = "bytes=";
  for (const FilePart& part : *parts) {
    if (part.size == 0 || part.size > left || part.first > size - part.size) std::abort();
    left -= part.size;
    if (again.back() != '=') again += ',';
    again += std::to_string(part.first) + '-' + std::to_string(part.first + part.size - 1);
  }
  if (parts->empty()) return 0;
  const auto same = select_ranges(again, size);
  if (!same || same->size() != parts->size()) std::abort();
  for (std::size_t i = 0; i < parts->size(); ++i)
    if ((*same)[i].first != (*parts)[i].first || (*same)[i].size != (*parts)[i].size) std::abort();
  return 0;
}
