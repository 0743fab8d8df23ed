// One DICOM file, through GDCM: its header's few fields and its pixels.
//
// GDCM and not ITK's GDCMImageIO over it, which rescales pixels as it reads and so loses both the
// 16 bits and the slope.
#include "field/volume_dicom.h"

#include <gdcmImageReader.h>
#include <gdcmReader.h>
#include <gdcmTrace.h>

#include <cmath>
#include <fstream>
#include <mutex>
#include <sstream>

#include "field/volume_io.h"

namespace slf::volume_io {

namespace {

// GDCM tells its troubles on stderr unless told not to, once for the process.
void silence_gdcm() {
  static std::once_flag once;
  std::call_once(once, [] {
    gdcm::Trace::DebugOff();
    gdcm::Trace::WarningOff();
    gdcm::Trace::ErrorOff();
  });
}

Result<std::string> read_checked(const std::string& path) {
  const auto size = file_size(path);
  if (!size) return tl::unexpected(size.error());
  std::string bytes(*size, '\0');
  std::ifstream file(path, std::ios::binary);
  if (!file.read(bytes.data(), static_cast<std::streamsize>(bytes.size())))
    return fail(ErrorCode::io, path, ": cannot be read");
  if (auto checked = check_dicom_structure(path, bytes); !checked)
    return tl::unexpected(checked.error());
  return bytes;
}

std::string text_of(const gdcm::DataSet& set, std::uint16_t group, std::uint16_t element) {
  const gdcm::Tag tag(group, element);
  if (!set.FindDataElement(tag)) return {};
  const auto* value = set.GetDataElement(tag).GetByteValue();
  if (!value || !value->GetPointer()) return {};
  std::string text(value->GetPointer(), value->GetLength());
  text.resize(std::min(text.find('\0'), text.size()));
  return std::string(trim(text));
}

/// Decimal strings, backslash between; empty where absent or not numbers.
std::vector<double> numbers_of(const gdcm::DataSet& set, std::uint16_t group,
                               std::uint16_t element) {
  const std::string text = text_of(set, group, element);
  std::vector<double> result;
  std::stringstream parts(text);
  for (std::string part; std::getline(parts, part, '\\');) {
    const auto value = parse_number(part);
    if (!value || !std::isfinite(*value)) return {};
    result.push_back(*value);
  }
  return result;
}

std::optional<ScalarType> scalar_type(const gdcm::PixelFormat& format) {
  switch (format.GetScalarType()) {
    case gdcm::PixelFormat::UINT8:
      return ScalarType::u8;
    case gdcm::PixelFormat::INT8:
      return ScalarType::i8;
    case gdcm::PixelFormat::UINT12:
    case gdcm::PixelFormat::UINT16:
      return ScalarType::u16;
    case gdcm::PixelFormat::INT12:
    case gdcm::PixelFormat::INT16:
      return ScalarType::i16;
    case gdcm::PixelFormat::UINT32:
      return ScalarType::u32;
    case gdcm::PixelFormat::INT32:
      return ScalarType::i32;
    case gdcm::PixelFormat::FLOAT32:
      return ScalarType::f32;
    case gdcm::PixelFormat::FLOAT64:
      return ScalarType::f64;
    default:
      return std::nullopt;
  }
}

std::uint32_t integer_of(const gdcm::DataSet& set, std::uint16_t group, std::uint16_t element,
                         std::uint32_t otherwise) {
  const gdcm::Tag tag(group, element);
  if (!set.FindDataElement(tag)) return otherwise;
  const auto* value = set.GetDataElement(tag).GetByteValue();
  if (!value || value->GetLength() < 2) return otherwise;
  const auto* p = reinterpret_cast<const unsigned char*>(value->GetPointer());
  return static_cast<std::uint32_t>(p[0] | p[1] << 8);
}

Result<void> read_format(const gdcm::DataSet& set, DicomSlice& slice) {
  slice.height = integer_of(set, 0x0028, 0x0010, 0);
  slice.width = integer_of(set, 0x0028, 0x0011, 0);
  if (const auto samples = integer_of(set, 0x0028, 0x0002, 1); samples != 1)
    return fail(ErrorCode::unsupported, slice.path, ": pixels of ", samples,
                " components (colour), expected one number each: extract one component");
  if (const auto photometric = text_of(set, 0x0028, 0x0004); photometric == "PALETTE COLOR")
    return fail(ErrorCode::unsupported, slice.path, ": palette colours, expected grey values");
  if (const auto frames = numbers_of(set, 0x0028, 0x0008); !frames.empty() && frames[0] > 1)
    return fail(ErrorCode::unsupported, slice.path, ": ", frames[0],
                " frames in one DICOM file; convert it, e.g. `dcm2niix FOLDER`");
  const auto allocated = integer_of(set, 0x0028, 0x0100, 0);
  const auto stored = integer_of(set, 0x0028, 0x0101, allocated);
  if (stored == 0 || stored > allocated || (allocated != 8 && allocated != 16 && allocated != 32))
    return fail(ErrorCode::unsupported, slice.path, ": ", stored, " of ", allocated,
                " bits a pixel, expected 8, 16 or 32 allocated");
  const bool is_signed = integer_of(set, 0x0028, 0x0103, 0) == 1;
  slice.type = allocated == 8    ? (is_signed ? ScalarType::i8 : ScalarType::u8)
               : allocated == 16 ? (is_signed ? ScalarType::i16 : ScalarType::u16)
                                 : (is_signed ? ScalarType::i32 : ScalarType::u32);
  if (slice.width == 0 || slice.height == 0)
    return fail(ErrorCode::bad_file, slice.path, ": Rows x Columns are ", slice.height, "x",
                slice.width);
  return {};
}

Result<void> read_place(const gdcm::DataSet& set, DicomSlice& slice) {
  const auto position = numbers_of(set, 0x0020, 0x0032);
  const auto orientation = numbers_of(set, 0x0020, 0x0037);
  auto spacing = numbers_of(set, 0x0028, 0x0030);
  if (position.size() != 3 || orientation.size() != 6 || spacing.size() != 2)
    return fail(ErrorCode::bad_file, slice.path, ": needs ImagePositionPatient (3 numbers, found ",
                position.size(), "), ImageOrientationPatient (6, found ", orientation.size(),
                ") and PixelSpacing (2, found ", spacing.size(), ") to be placed in space");
  slice.position = {position[0], position[1], position[2]};
  slice.row = {orientation[0], orientation[1], orientation[2]};
  slice.column = {orientation[3], orientation[4], orientation[5]};
  slice.spacing = {spacing[1], spacing[0]};  // the file states the one between rows first
  const double sine = glm::length(glm::cross(slice.row, slice.column));
  if (!(std::abs(sine - 1) < 1e-2))
    return fail(ErrorCode::bad_file, slice.path,
                ": ImageOrientationPatient is not two perpendicular unit vectors");
  if (!(slice.spacing.x > 0) || !(slice.spacing.y > 0))
    return fail(ErrorCode::bad_file, slice.path, ": PixelSpacing is ", slice.spacing.y, " by ",
                slice.spacing.x, ", expected positive numbers");
  return {};
}

}  // namespace

Result<DicomSlice> read_dicom_header(const std::string& path) {
  silence_gdcm();
  const auto bytes = read_checked(path);
  if (!bytes) return tl::unexpected(bytes.error());
  try {
    std::istringstream stream(*bytes);
    gdcm::Reader reader;
    reader.SetStream(stream);
    const gdcm::Tag pixel_data(0x7fe0, 0x0010);
    if (!reader.ReadUpToTag(pixel_data))
      return fail(ErrorCode::bad_file, path, ": damaged DICOM header");
    const auto& set = reader.GetFile().GetDataSet();
    DicomSlice slice;
    slice.path = path;
    if (!set.FindDataElement(gdcm::Tag(0x0028, 0x0010))) return slice;
    if (auto r = read_format(set, slice); !r) return tl::unexpected(r.error());
    if (auto r = read_place(set, slice); !r) return tl::unexpected(r.error());
    if (const auto slope = numbers_of(set, 0x0028, 0x1053); !slope.empty() && slope[0] != 0)
      slice.slope = slope[0];
    if (const auto intercept = numbers_of(set, 0x0028, 0x1052); !intercept.empty())
      slice.intercept = intercept[0];
    slice.series = text_of(set, 0x0020, 0x000e);
    if (slice.series.empty()) slice.series = "(no SeriesInstanceUID)";
    return slice;
  } catch (const std::exception& error) {
    return fail(ErrorCode::bad_file, path, ": damaged DICOM file: ", error.what());
  }
}

Result<std::vector<std::byte>> read_dicom_pixels(const DicomSlice& slice) {
  silence_gdcm();
  const auto bytes = read_checked(slice.path);
  if (!bytes) return tl::unexpected(bytes.error());
  const std::uint64_t needed =
      std::uint64_t{slice.width} * slice.height * bytes_per_voxel(slice.type);
  // Wavelet codecs have no bound like deflate's: a blank slice is a few hundred bytes.
  constexpr std::uint64_t kAlwaysAllowed = std::uint64_t{64} << 20;
  if (needed > kAlwaysAllowed && needed / 1032 > bytes->size())
    return fail(ErrorCode::bad_file, slice.path, ": ", slice.height, "x", slice.width,
                " pixels cannot be in a file of ", bytes->size(), " bytes");
  try {
    std::istringstream stream(*bytes);
    gdcm::ImageReader reader;
    reader.SetStream(stream);
    if (!reader.Read())
      return fail(ErrorCode::bad_file, slice.path,
                  ": its DICOM pixel data are missing, damaged or in an unknown encoding");
    const gdcm::Image& image = reader.GetImage();
    if (image.GetDimension(0) != slice.width || image.GetDimension(1) != slice.height ||
        scalar_type(image.GetPixelFormat()) != slice.type || image.GetBufferLength() != needed)
      return fail(ErrorCode::bad_file, slice.path, ": its pixel data do not agree with its header");
    std::vector<std::byte> pixels(needed);
    if (!image.GetBuffer(reinterpret_cast<char*>(pixels.data())))
      return fail(ErrorCode::bad_file, slice.path, ": its DICOM pixel data cannot be decoded");
    return pixels;
  } catch (const std::exception& error) {
    return fail(ErrorCode::bad_file, slice.path, ": damaged DICOM file: ", error.what());
  }
}

}  // namespace slf::volume_io
