// Any bytes decode to a whole picture or to an error that names it.
#include <cstdint>
#include <cstdlib>

#include "image/formats.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto image =
      slf::image_formats::decode("picture", {reinterpret_cast<const std::byte*>(data), size});
  if (!image) {
    if (!image.error().message.starts_with("picture: ")) std::abort();
    return 0;
  }
  const std::size_t pixels = std::size_t{image->width} * image->height;
  if (pixels == 0 || image->rgba.size() != pixels) std::abort();
  if (!image->depth.empty() && image->depth.size() != pixels) std::abort();
  return 0;
}
