// The sizes of PNG, JPEG and TIFF pictures from their headers. Other formats are decoded.
#include <cstring>
#include <optional>

#include "base/file.h"
#include "base/try.h"
#include "image/formats.h"
#include "image/tiff_file.h"

namespace slf::image_formats {
namespace {

/// The picture's frame header comes after tables and metadata, such as a thumbnail.
constexpr std::size_t kHead = 1 << 20;

std::optional<ImageSize> png_size(ByteSpan head) {
  if (head.size() < 24 || std::memcmp(head.data(), "\x89PNG", 4) != 0) return std::nullopt;
  return ImageSize{load_be<std::uint32_t>(&head[16]), load_be<std::uint32_t>(&head[20])};
}

std::optional<ImageSize> jpeg_size(ByteSpan head) {
  if (head.size() < 4 || std::memcmp(head.data(), "\xff\xd8\xff", 3) != 0) return std::nullopt;
  for (std::size_t at = 2; at + 9 < head.size() && head[at] == std::byte{0xff};) {
    const auto marker = std::to_integer<unsigned>(head[at + 1]);
    const bool frame =
        marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (frame)
      return ImageSize{load_be<std::uint16_t>(&head[at + 7]),
                       load_be<std::uint16_t>(&head[at + 5])};
    at += 2 + load_be<std::uint16_t>(&head[at + 2]);
  }
  return std::nullopt;
}

}  // namespace

Result<ImageSize> read_image_size(const std::string& path) {
  auto file = SLF_TRY(open_regular(path));
  Bytes head(kHead);
  file.read(reinterpret_cast<char*>(head.data()), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(file.gcount()));
  for (const auto& size : {png_size(head), jpeg_size(head)})
    if (size) {
      SLF_TRY(check_size(path, size->width, size->height));
      return *size;
    }
  if (looks_like_tiff(chars_of(head))) return tiff_size(path);
  const auto image = SLF_TRY(read_image(path));
  return ImageSize{image.width, image.height};
}

}  // namespace slf::image_formats
