#include "slf/image.h"

#include <filesystem>
#include <string_view>
#include <utility>

#include "base/ascii.h"
#include "base/file.h"
#include "base/half.h"
#include "base/try.h"
#include "image/formats.h"
#include "image/tiff_file.h"

namespace slf {
namespace image_formats {

Result<void> check_size(const std::string& name, std::uint64_t width, std::uint64_t height) {
  if (width == 0 || height == 0) return bad_file(name, "has no pixels (", width, "x", height, ")");
  if (width > kMaxSide || height > kMaxSide || width * height > kMaxPixels)
    return unsupported(name, "claims ", width, "x", height, " pixels; pictures are read up to ",
                       kMaxSide, " on a side and ", kMaxPixels, " in all");
  return {};
}

namespace {

using Decoder = Result<Image> (*)(const std::string& name, ByteSpan bytes);

/// The decoder for what begins with these bytes.
Result<Decoder> decoder_for(const std::string& name, ByteSpan start) {
  for (const auto& [magic, decoder] : {std::pair<std::string_view, Decoder>{"\x89PNG", decode_png},
                                       {"\xff\xd8\xff", decode_jpeg},
                                       {"\x76\x2f\x31\x01", decode_exr},
                                       {"#?RADIANCE\n", decode_hdr},
                                       {"#?RGBE\n", decode_hdr}})
    if (chars_of(start).starts_with(magic)) return decoder;
  if (looks_like_tiff(chars_of(start))) return decode_tiff;
  return bad_file(name, "not a PNG, JPEG, TIFF, OpenEXR or Radiance HDR picture");
}

}  // namespace

Result<Image> decode(const std::string& name, ByteSpan bytes) {
  const auto decoder = SLF_TRY(decoder_for(name, bytes));
  return decoder(name, bytes);
}

}  // namespace image_formats

namespace {

/// A file of kMaxPixels pixels is no longer than their float RGBA and Z, plus some metadata.
constexpr std::uint64_t kMaxFileBytes = image_formats::kMaxPixels * 20 + (std::uint64_t{1} << 24);

std::string lower_extension(const std::string& path) {
  return lower_case(std::filesystem::path(path).extension().string());
}

Result<void> check_pixels(const std::string& path, const Image& image) {
  const std::size_t expected = std::size_t{image.width} * image.height;
  if (expected == 0) return misuse(path, "the picture has no pixels");
  if (image.rgba.size() != expected || (!image.depth.empty() && image.depth.size() != expected))
    return misuse(path, "a picture of ", image.width, "x", image.height, " has ", image.rgba.size(),
                  " colours and ", image.depth.size(), " depths");
  return {};
}

}  // namespace

std::vector<std::uint8_t> to_rgb8(const Image& image, const glm::vec3& background) {
  std::vector<std::uint8_t> rgb;
  rgb.reserve(image.rgba.size() * 3);
  for (const glm::vec4& pixel : image.rgba) {
    const glm::vec3 color = glm::vec3(pixel) + (1 - pixel.a) * background;
    for (int c = 0; c < 3; ++c) rgb.push_back(byte_from_float(color[c]));
  }
  return rgb;
}

Result<Bytes> encode_image(const std::string& path, const Image& image,
                           const ImageFileOptions& options) try {
  SLF_TRY(check_pixels(path, image));
  const std::string extension = lower_extension(path);
  if (extension == ".png") return image_formats::encode_png(path, image, options);
  if (extension == ".jpg" || extension == ".jpeg")
    return image_formats::encode_jpeg(path, image, options);
  if (extension == ".exr") return image_formats::encode_exr(path, image);
  return misuse(path, "unknown kind of picture '", extension, "'; use .png, .jpg or .exr");
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<void> write_image(const std::string& path, const Image& image,
                         const ImageFileOptions& options) try {
  const Bytes bytes = SLF_TRY(encode_image(path, image, options));
  return write_file(path, bytes);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<Image> read_image(const std::string& path) try {
  const auto check = [&](ByteSpan start) -> Result<void> {
    SLF_TRY(image_formats::decoder_for(path, start));
    return {};
  };
  const Bytes bytes = SLF_TRY(read_file(path, kMaxFileBytes, check));
  return image_formats::decode(path, bytes);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
