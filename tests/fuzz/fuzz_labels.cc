// Tables of labels from any bytes: an error that names the source, or styles within their ranges.
#include <cstdint>
#include <cstdlib>
#include <string>

#include "slf/volume_parts.h"

namespace {

void require(bool condition) {
  if (!condition) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  const auto table = slf::parse_label_table(text, "input");
  if (!table) {
    require(table.error().message.starts_with("input"));
    return 0;
  }
  require(!table->empty());
  for (const auto& [id, style] : *table) {
    require(style.opacity >= 0 && style.opacity <= 1);
    for (int i = 0; i < 3 && style.color; ++i)
      require((*style.color)[i] >= 0 && (*style.color)[i] <= 1);
  }
  return 0;
}
