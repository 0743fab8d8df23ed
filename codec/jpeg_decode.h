// Decodes a baseline JPEG scan: the entropy-coded bytes of a picture of known size, without
// headers. Uses libjpeg-turbo, and returns its errors and warnings as Result.
#pragma once

#include <cstdint>
#include <span>

#include "base/bytes.h"
#include "codec/jpeg_tables.h"
#include "slf/error.h"

namespace slf::codec {

enum class JpegColor : std::uint8_t {
  gray,       ///< one component, pixels of 1 byte
  ycbcr_444,  ///< three components, pixels of 4 bytes: R, G, B and an undefined byte
  ycbcr_420,  ///< the same, with chroma at half the resolution in both directions
};

struct JpegShape {
  std::uint32_t width = 0;   ///< 1..65500, a multiple of alignment(color)
  std::uint32_t height = 0;  ///< likewise
  JpegColor color = JpegColor::gray;
};

[[nodiscard]] constexpr std::size_t pixel_bytes(JpegColor color) {
  return color == JpegColor::gray ? 1 : 4;
}
/// The side of a minimum coded unit, in pixels.
[[nodiscard]] constexpr std::uint32_t alignment(JpegColor color) {
  return color == JpegColor::ycbcr_420 ? 16 : 8;
}

/// Fills `pixels`, width × height × pixel_bytes(color) bytes, from an untrusted scan.
/// bad_file: the scan is damaged: too short, too long, or with a marker in it.
[[nodiscard]] Result<void> decode_scan(const JpegTables& tables, const JpegShape& shape,
                                       ByteSpan scan, std::span<std::uint8_t> pixels);

}  // namespace slf::codec
