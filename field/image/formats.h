// The picture formats in memory: Image to bytes, bytes to Image. Internal to field: users call
// write_image and read_image; tests and fuzzers come in here.
//
// Decoders take untrusted bytes: sizes are checked before anything is allocated for them, and the
// libraries' longjmps and exceptions end here. `name` is what messages call the picture.
// Errors of decoders: bad_file, damaged or truncated; unsupported, valid but not read here.
#pragma once

#include <cmath>
#include <cstdint>
#include <string>

#include "base/bytes.h"
#include "slf/error.h"
#include "slf/image.h"

namespace slf::image_formats {

/// The largest picture read: pixels on a side, and in all (1 GiB of RGBA).
inline constexpr std::uint64_t kMaxSide = 32768;
inline constexpr std::uint64_t kMaxPixels = std::uint64_t{1} << 26;

/// unsupported when a picture that claims this size is too large to read; bad_file when empty.
[[nodiscard]] Result<void> check_size(const std::string& name, std::uint64_t width,
                                      std::uint64_t height);

/// A value in 0..1 as 8 bits, to the nearest; what is outside is clamped, NaN gives 0.
[[nodiscard]] inline std::uint8_t to_byte(float value) {
  if (!(value > 0)) return 0;
  return value >= 1 ? 255 : static_cast<std::uint8_t>(std::lround(value * 255.0F));
}

/// REQUIRES (all encoders): at least one pixel, and width × height of them.
/// failed: the format or its library refuses, with its reason (a side too long, say).
[[nodiscard]] Result<Bytes> encode_png(const std::string& name, const Image& image,
                                       const ImageFileOptions& options);
[[nodiscard]] Result<Bytes> encode_jpeg(const std::string& name, const Image& image,
                                        const ImageFileOptions& options);
[[nodiscard]] Result<Bytes> encode_exr(const std::string& name, const Image& image);

[[nodiscard]] Result<Image> decode_png(const std::string& name, ByteSpan bytes);
[[nodiscard]] Result<Image> decode_jpeg(const std::string& name, ByteSpan bytes);
[[nodiscard]] Result<Image> decode_exr(const std::string& name, ByteSpan bytes);

/// Decodes what the first bytes say it is.
[[nodiscard]] Result<Image> decode(const std::string& name, ByteSpan bytes);

}  // namespace slf::image_formats
