// One DICOM slice: its elements, where it lies, its pixels.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <string>
#include <string_view>

#include "base/error.h"
#include "field/volume.h"

namespace slf::volume_io {

/// The elements of a file's outermost data set, by tag (group << 16 | element).
/// REQUIRES: the bytes it was parsed from outlive it.
struct DicomElements {
  std::string syntax;  ///< transfer syntax UID
  std::map<std::uint32_t, std::string_view> values{};
  bool compressed = false;  ///< pixel data are a sequence of encoded fragments
};

/// Walks every element, nested ones too, and holds its length against the bytes there are.
/// bad_file: a length that leaves its parent. unsupported: big endian or deflated transfer syntax.
[[nodiscard]] Result<DicomElements> parse_dicom(const std::string& path, std::string_view bytes);

/// Where a slice lies and how its pixels are stored and scaled.
struct DicomSlice {
  std::string path;
  std::string series;
  glm::dvec3 position{0.0};
  glm::dvec3 row{0.0}, column{0.0};  ///< directions in which x and y of the picture grow
  glm::dvec2 spacing{0.0};           ///< along row, along column
  double slope = 1, intercept = 0;
  std::uint32_t width = 0, height = 0;
  ScalarType type = ScalarType::u8;
  unsigned bits_stored = 8, high_bit = 7;
};

/// A file that is DICOM but no picture (a DICOMDIR, a report) gives an empty `series`.
[[nodiscard]] Result<DicomSlice> read_dicom_header(const std::string& path);

/// width × height pixels in native byte order, before slope and intercept.
/// unsupported: compressed pixel data.
[[nodiscard]] Result<std::vector<std::byte>> read_dicom_pixels(const DicomSlice& slice);

}  // namespace slf::volume_io
