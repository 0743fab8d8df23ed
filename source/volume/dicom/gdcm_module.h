// The module slf_gdcm.so, which holds all that uses GDCM. Internal.
//
// It is loaded when compressed DICOM pixels are first read. GDCM makes its dictionary of all tags
// when it is loaded, which takes as long as starting the rest of slf, and 13 MB.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace slf::volume_io {

/// A DICOM file whose pixels are compressed, and what its header, which our parser has read, says
/// of them.
struct GdcmInput {
  std::string_view bytes;  ///< the file, unpacked
  std::uint32_t width, height;
  std::uint64_t pixel_bytes;
  bool jpeg_2000;
};

/// What the module exports: decodes all frames. False: the file is damaged, or its pixels are not
/// `pixels.size()` bytes of what the header says. May crash: call it in a child process.
using GdcmDecode = bool(const GdcmInput& input, std::span<std::byte> pixels);
inline constexpr const char* kGdcmDecode = "slf_gdcm_decode";

}  // namespace slf::volume_io
