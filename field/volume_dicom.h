// What of a DICOM file the series reader needs, and the check that comes before any library.
#pragma once

#include <glm/glm.hpp>
#include <string>
#include <string_view>

#include "base/error.h"
#include "field/volume.h"

namespace slf::volume_io {

/// Walks every element of a file and holds its length against the bytes there are. GDCM allocates
/// by those lengths, up to 4 GiB for one that lies, and recurses by them.
/// bad_file: a length that leaves its parent. unsupported: big endian or deflated transfer syntax.
[[nodiscard]] Result<void> check_dicom_structure(const std::string& path, std::string_view bytes);

/// One slice: where it lies and how its pixels are scaled.
struct DicomSlice {
  std::string path;
  std::string series;
  glm::dvec3 position{0.0};
  glm::dvec3 row{0.0}, column{0.0};  ///< directions in which x and y of the picture grow
  glm::dvec2 spacing{0.0};           ///< along row, along column
  double slope = 1, intercept = 0;
  std::uint32_t width = 0, height = 0;
  ScalarType type = ScalarType::u8;
};

/// A file that is DICOM but no picture (a DICOMDIR, a report) gives an empty `series`.
[[nodiscard]] Result<DicomSlice> read_dicom_header(const std::string& path);

/// width × height pixels in native byte order, before slope and intercept.
[[nodiscard]] Result<std::vector<std::byte>> read_dicom_pixels(const DicomSlice& slice);

}  // namespace slf::volume_io
