#include <gdcmImageReader.h>
#include <gdcmSequenceOfFragments.h>

#include <sstream>
#include <string>

#include "source/volume/dicom/gdcm_module.h"

namespace slf::volume_io {
namespace {

/// Whether the size in a JPEG 2000 stream is that of the header. GDCM does not check this, and
/// leaves pixels unset if the stream's picture is smaller.
bool is_of_stated_size(const GdcmInput& file, const gdcm::Image& image) {
  const auto* fragments = image.GetDataElement().GetSequenceOfFragments();
  if (!fragments) return false;
  for (std::size_t i = 0; i < fragments->GetNumberOfFragments(); ++i) {
    const auto* value = fragments->GetFragment(i).GetByteValue();
    if (!value) return false;
    const std::string_view bytes(value->GetPointer(), value->GetLength());
    const auto start = bytes.substr(0, 512).find("\xff\x4f\xff\x51");  // SOC, SIZ
    if (start == std::string_view::npos) continue;                     // continues the last
    if (bytes.size() < start + 24) return false;
    const auto field = [&](std::size_t at) {
      std::uint32_t number = 0;
      for (std::size_t k = 0; k < 4; ++k)
        number = number << 8 | static_cast<std::uint8_t>(bytes[start + at + k]);
      return number;
    };
    if (field(8) - field(16) != file.width || field(12) - field(20) != file.height) return false;
  }
  return true;
}

}  // namespace

extern "C" bool slf_gdcm_decode(const GdcmInput& input, std::span<std::byte> pixels) {
  gdcm::ImageReader reader;
  std::istringstream file{std::string(input.bytes)};
  reader.SetStream(file);
  if (!reader.Read()) return false;
  const gdcm::Image& image = reader.GetImage();
  const auto* size = image.GetDimensions();
  if (size[0] != input.width || size[1] != input.height ||
      image.GetPixelFormat().GetPixelSize() != input.pixel_bytes ||
      image.GetBufferLength() != pixels.size())
    return false;
  if (input.jpeg_2000 && !is_of_stated_size(input, image)) return false;
  return image.GetBuffer(reinterpret_cast<char*>(pixels.data()));
}

}  // namespace slf::volume_io
