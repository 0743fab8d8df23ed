// Manifests: any text parses to a manifest that can be used, and written and read again, or to an
// error that names the file.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "field/manifest.h"

namespace {

void require(bool promise) {
  if (!promise) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto manifest = slf::Manifest::parse({reinterpret_cast<const char*>(data), size}, "x.slf");
  if (!manifest) {
    require(manifest.error().message.find("x.slf") == 0);
    require(manifest.error().code == slf::ErrorCode::bad_file ||
            manifest.error().code == slf::ErrorCode::unsupported);
    return 0;
  }
  const slf::FieldShape& shape = manifest->shape;
  require(shape.check().has_value());
  for (unsigned level = 0; level <= shape.finest_level; ++level)
    require(shape.tiles(level) > 0 && shape.slabs(level) > 0);
  const auto again = slf::Manifest::parse(manifest->to_json()->dump(), "x.slf");
  require(again.has_value() && again->to_json() == manifest->to_json());
  return 0;
}
