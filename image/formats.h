// Picture formats in memory: Image to bytes and back. Internal: programs call write_image and
// read_image; tests and fuzzers call these functions.
//
// Decoders accept untrusted bytes. They check sizes before they allocate, and catch the libraries'
// longjmps and exceptions. `name` is the name of the picture in messages.
// Errors of decoders: bad_file: damaged or truncated. unsupported: valid, but not supported here.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"
#include "slf/image.h"

namespace slf::image_formats {

/// The largest picture that decoders accept: pixels on a side, and in all (1 GiB of RGBA).
inline constexpr std::uint64_t kMaxSide = 32768;
inline constexpr std::uint64_t kMaxPixels = std::uint64_t{1} << 26;

/// Checks the size that a picture claims. unsupported: too large. bad_file: no pixels.
[[nodiscard]] Result<void> check_size(const std::string& name, std::uint64_t width,
                                      std::uint64_t height);

/// All encoders: REQUIRES: width × height pixels, at least one.
/// failed: the format or its library refuses, for example because a side is too long.
[[nodiscard]] Result<Bytes> encode_png(const std::string& name, const Image& image,
                                       const ImageFileOptions& options);
[[nodiscard]] Result<Bytes> encode_jpeg(const std::string& name, const Image& image,
                                        const ImageFileOptions& options);
[[nodiscard]] Result<Bytes> encode_exr(const std::string& name, const Image& image);

[[nodiscard]] Result<Image> decode_png(const std::string& name, ByteSpan bytes);
/// Its colours are not multiplied by alpha, so they are there where it is 0.
[[nodiscard]] Result<Image> decode_straight_png(const std::string& name, ByteSpan bytes);
[[nodiscard]] Result<Image> decode_jpeg(const std::string& name, ByteSpan bytes);
[[nodiscard]] Result<Image> decode_exr(const std::string& name, ByteSpan bytes);
[[nodiscard]] Result<Image> decode_hdr(const std::string& name, ByteSpan bytes);
[[nodiscard]] Result<Image> decode_tiff(const std::string& name, ByteSpan bytes);

/// A JPEG as it is stored: 1 channel of grey, or 3 of colour, of 8 bits each, side by side.
struct JpegSamples {
  std::uint32_t width = 0, height = 0, channels = 0;
  std::vector<std::uint8_t> samples;
};
[[nodiscard]] Result<JpegSamples> decode_jpeg_samples(const std::string& name, ByteSpan bytes);

struct ImageSize {
  std::uint32_t width = 0, height = 0;
  bool operator==(const ImageSize&) const = default;
};
/// Of a TIFF file. Errors as read_image().
[[nodiscard]] Result<ImageSize> tiff_size(const std::string& path);
/// The size that a file states in its header. Errors as read_image().
[[nodiscard]] Result<ImageSize> read_image_size(const std::string& path);

/// Decodes a picture in the format that its first bytes indicate.
[[nodiscard]] Result<Image> decode(const std::string& name, ByteSpan bytes);

}  // namespace slf::image_formats
