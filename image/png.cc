// PNG through libpng's simplified interface, which handles its longjmps internally.

#include <png.h>

#include <cstring>

#include "base/half.h"
#include "base/try.h"
#include "image/formats.h"

namespace slf::image_formats {
namespace {

/// A png_image with a destructor.
struct PngImage : png_image {
  PngImage() : png_image{} { version = PNG_IMAGE_VERSION; }
  PngImage(const PngImage&) = delete;
  PngImage& operator=(const PngImage&) = delete;
  ~PngImage() { png_image_free(this); }
};

/// Straight colour, as PNG requires: not multiplied by alpha. Where alpha is 0, colour is lost.
std::vector<std::uint8_t> to_straight_rgba8(const Image& image) {
  std::vector<std::uint8_t> rgba;
  rgba.reserve(image.rgba.size() * 4);
  for (const glm::vec4& pixel : image.rgba) {
    const float unmultiply = pixel.a > 0 ? 1 / pixel.a : 0;
    for (int c = 0; c < 3; ++c) rgba.push_back(byte_from_float(pixel[c] * unmultiply));
    rgba.push_back(byte_from_float(pixel.a));
  }
  return rgba;
}

/// Whether every chunk up to IEND exists. The library stops after the last row, so it would not
/// notice that the file is truncated after it.
bool reaches_end(ByteSpan bytes) {
  constexpr std::size_t kSignature = 8, kLengthTypeCrc = 12;
  std::size_t at = kSignature;
  while (at <= bytes.size() && bytes.size() - at >= kLengthTypeCrc) {
    const std::size_t length = load_be<std::uint32_t>(&bytes[at]);
    if (length > bytes.size() - at - kLengthTypeCrc) return false;
    if (std::memcmp(&bytes[at + 4], "IEND", 4) == 0) return true;
    at += kLengthTypeCrc + length;
  }
  return false;
}

}  // namespace

Result<Bytes> encode_png(const std::string& name, const Image& image,
                         const ImageFileOptions& options) {
  PngImage png;
  png.width = image.width;
  png.height = image.height;
  png.format = options.transparent ? PNG_FORMAT_RGBA : PNG_FORMAT_RGB;
  const std::vector<std::uint8_t> pixels =
      options.transparent ? to_straight_rgba8(image) : to_rgb8(image, options.background);

  Bytes bytes(PNG_IMAGE_PNG_SIZE_MAX(png));
  png_alloc_size_t size = bytes.size();
  if (png_image_write_to_memory(&png, bytes.data(), &size, 0, pixels.data(), 0, nullptr) == 0)
    return fail(ErrorCode::failed, name, ": cannot encode as PNG: ", png.message);
  bytes.resize(size);
  return bytes;
}

Result<Image> decode_png(const std::string& name, ByteSpan bytes) {
  auto image = decode_straight_png(name, bytes);
  if (image)
    for (glm::vec4& c : image->rgba) c = {glm::vec3(c) * c.a, c.a};
  return image;
}

Result<Image> decode_straight_png(const std::string& name, ByteSpan bytes) {
  if (!reaches_end(bytes)) return bad_file(name, "PNG is truncated");
  PngImage png;
  if (png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()) == 0)
    return bad_file(name, "damaged PNG: ", png.message);
  SLF_TRY(check_size(name, png.width, png.height));

  // Treat 16 bits without a stated gamma as sRGB, like 8 bits.
  png.flags |= PNG_IMAGE_FLAG_16BIT_sRGB;
  png.format = PNG_FORMAT_RGBA;
  std::vector<std::uint8_t> pixels(PNG_IMAGE_SIZE(png));
  if (png_image_finish_read(&png, nullptr, pixels.data(), 0, nullptr) == 0)
    return bad_file(name, "damaged PNG: ", png.message);

  Image image{png.width, png.height, {}, {}};
  image.rgba.reserve(pixels.size() / 4);
  for (std::size_t i = 0; i < pixels.size(); i += 4)
    image.rgba.push_back(glm::vec4(pixels[i], pixels[i + 1], pixels[i + 2], pixels[i + 3]) /
                         255.0F);
  return image;
}

}  // namespace slf::image_formats
