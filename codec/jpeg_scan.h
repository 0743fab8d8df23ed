// One baseline JPEG scan at a time: pictures of a known size to entropy-coded bytes and back, with
// all headers left out. libjpeg-turbo does the work; its errors and warnings come back as Result.
#pragma once

#include <cstdint>
#include <span>

#include "base/bytes.h"
#include "base/error.h"
#include "codec/jpeg_tables.h"

namespace slf::codec {

enum class JpegColor : std::uint8_t {
  gray,       ///< one component, pixels of 1 byte
  ycbcr_444,  ///< three components, pixels of 4 bytes: R, G, B and one that is ignored
  ycbcr_420,  ///< the same, chroma at half the resolution
};

struct JpegShape {
  std::uint32_t width = 0;   ///< 1..65500
  std::uint32_t height = 0;  ///< 1..65500
  JpegColor color = JpegColor::gray;
};

[[nodiscard]] constexpr std::size_t pixel_bytes(JpegColor color) {
  return color == JpegColor::gray ? 1 : 4;
}

/// Appends the entropy-coded bytes of a picture to `scan`.
/// REQUIRES: pixels holds width × height × pixel_bytes(color) bytes.
[[nodiscard]] Result<void> append_scan(const JpegTables& tables, const JpegShape& shape,
                                       std::span<const std::uint8_t> pixels, Bytes& scan);

/// Decodes what append_scan wrote; untrusted. The ignored byte of a pixel comes out as 255.
/// bad_file: the scan is damaged: it ends early, goes on too long or holds a marker.
[[nodiscard]] Result<void> read_scan(const JpegTables& tables, const JpegShape& shape,
                                     ByteSpan scan, std::span<std::uint8_t> pixels);

}  // namespace slf::codec
