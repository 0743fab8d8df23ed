// One DICOM file: its header's few fields and its pixels, uncompressed.
//
// Not through ITK, whose GDCMImageIO rescales pixels as it reads and so loses both the 16 bits and
// the slope; nor through GDCM itself, which aborts the process on damaged files (Debian builds it
// with its assertions) and allocates up to 4 GiB by a length that lies.
#include "field/volume_dicom.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>

#include "base/bytes.h"
#include "field/volume_io.h"

namespace slf::volume_io {

namespace {

enum Tag : std::uint32_t {
  kSopClass = 0x00080016,
  kSeriesInstanceUid = 0x0020000e,
  kPosition = 0x00200032,
  kOrientation = 0x00200037,
  kSamplesPerPixel = 0x00280002,
  kPhotometric = 0x00280004,
  kFrames = 0x00280008,
  kRows = 0x00280010,
  kColumns = 0x00280011,
  kPixelSpacing = 0x00280030,
  kBitsAllocated = 0x00280100,
  kBitsStored = 0x00280101,
  kHighBit = 0x00280102,
  kPixelRepresentation = 0x00280103,
  kRescaleIntercept = 0x00281052,
  kRescaleSlope = 0x00281053,
  kPixelData = 0x7fe00010,
};

Result<std::string> read_whole(const std::string& path) {
  const auto size = file_size(path);
  if (!size) return tl::unexpected(size.error());
  std::string bytes(*size, '\0');
  std::ifstream file(path, std::ios::binary);
  if (!file.read(bytes.data(), static_cast<std::streamsize>(bytes.size())))
    return fail(ErrorCode::io, path, ": cannot be read");
  return bytes;
}

std::string text_of(const DicomElements& elements, Tag tag) {
  const auto found = elements.values.find(tag);
  if (found == elements.values.end()) return {};
  return std::string(trim(found->second.substr(0, found->second.find('\0'))));
}

/// Whether a file without a picture is one that never has any: a directory, report, structure set,
/// presentation state, document, waveform or raw data. Any other has lost it.
bool is_pictureless(const DicomElements& elements) {
  constexpr std::uint32_t kDirectoryRecords = 0x00041220;
  if (elements.values.contains(kDirectoryRecords)) return true;
  const std::string sop_class = text_of(elements, kSopClass);
  for (const auto* kind : {"88.", "481.", "11.", "104.", "9.", "66"})
    if (sop_class.starts_with(std::string("1.2.840.10008.5.1.4.1.1.").append(kind))) return true;
  return false;
}

/// Decimal strings, backslash between; empty where absent or not numbers.
std::vector<double> numbers_of(const DicomElements& elements, Tag tag) {
  std::vector<double> result;
  std::istringstream parts(text_of(elements, tag));
  for (std::string part; std::getline(parts, part, '\\');) {
    const auto value = parse_number(part);
    if (!value || !std::isfinite(*value)) return {};
    result.push_back(*value);
  }
  return result;
}

unsigned integer_of(const DicomElements& elements, Tag tag, unsigned otherwise) {
  const auto found = elements.values.find(tag);
  if (found == elements.values.end() || found->second.size() < 2) return otherwise;
  return load_le<std::uint16_t>(reinterpret_cast<const std::byte*>(found->second.data()));
}

Result<void> read_format(const DicomElements& elements, DicomSlice& slice) {
  slice.height = integer_of(elements, kRows, 0);
  slice.width = integer_of(elements, kColumns, 0);
  if (slice.width == 0 || slice.height == 0)
    return fail(ErrorCode::bad_file, slice.path, ": Rows x Columns are ", slice.height, "x",
                slice.width);
  if (const auto samples = integer_of(elements, kSamplesPerPixel, 1); samples != 1)
    return fail(ErrorCode::unsupported, slice.path, ": pixels of ", samples,
                " components (colour), expected one number each: extract one component");
  if (text_of(elements, kPhotometric) == "PALETTE COLOR")
    return fail(ErrorCode::unsupported, slice.path, ": palette colours, expected grey values");
  if (const auto frames = numbers_of(elements, kFrames); !frames.empty() && frames[0] > 1)
    return fail(ErrorCode::unsupported, slice.path, ": ", frames[0],
                " frames in one DICOM file; convert it, e.g. `dcm2niix FOLDER`");
  const unsigned allocated = integer_of(elements, kBitsAllocated, 0);
  slice.bits_stored = integer_of(elements, kBitsStored, allocated);
  slice.high_bit = integer_of(elements, kHighBit, slice.bits_stored - 1);
  if ((allocated != 8 && allocated != 16 && allocated != 32) || slice.bits_stored == 0 ||
      slice.high_bit >= allocated || slice.high_bit + 1 < slice.bits_stored)
    return fail(ErrorCode::unsupported, slice.path, ": pixels of ", slice.bits_stored,
                " bits up to bit ", slice.high_bit, " of ", allocated,
                ", expected 8, 16 or 32 allocated");
  const bool is_signed = integer_of(elements, kPixelRepresentation, 0) == 1;
  slice.type = allocated == 8    ? (is_signed ? ScalarType::i8 : ScalarType::u8)
               : allocated == 16 ? (is_signed ? ScalarType::i16 : ScalarType::u16)
                                 : (is_signed ? ScalarType::i32 : ScalarType::u32);
  return {};
}

Result<void> read_place(const DicomElements& elements, DicomSlice& slice) {
  const auto position = numbers_of(elements, kPosition);
  const auto orientation = numbers_of(elements, kOrientation);
  const auto spacing = numbers_of(elements, kPixelSpacing);
  if (position.size() != 3 || orientation.size() != 6 || spacing.size() != 2)
    return fail(ErrorCode::bad_file, slice.path, ": needs ImagePositionPatient (3 numbers, found ",
                position.size(), "), ImageOrientationPatient (6, found ", orientation.size(),
                ") and PixelSpacing (2, found ", spacing.size(), ") to be placed in space");
  slice.position = {position[0], position[1], position[2]};
  slice.row = {orientation[0], orientation[1], orientation[2]};
  slice.column = {orientation[3], orientation[4], orientation[5]};
  slice.spacing = {spacing[1], spacing[0]};  // the file states the one between rows first
  const double sine = glm::length(glm::cross(slice.row, slice.column));
  if (!(std::abs(sine - 1) < 1e-2) || !(std::abs(glm::length(slice.row) - 1) < 1e-2))
    return fail(ErrorCode::bad_file, slice.path,
                ": ImageOrientationPatient is not two perpendicular unit vectors");
  if (!(slice.spacing.x > 0) || !(slice.spacing.y > 0))
    return fail(ErrorCode::bad_file, slice.path, ": PixelSpacing is ", slice.spacing.y, " by ",
                slice.spacing.x, ", expected positive numbers");
  return {};
}

/// Clears the bits beside the stored ones (overlays once lived there) and extends the sign.
template <class T>
void keep_stored_bits(std::vector<std::byte>& pixels, const DicomSlice& slice) {
  constexpr unsigned kBits = 8 * sizeof(T);
  if (slice.bits_stored == kBits) return;
  const unsigned left = kBits - 1 - slice.high_bit;
  const unsigned right = kBits - slice.bits_stored;
  for (std::size_t at = 0; at < pixels.size(); at += sizeof(T)) {
    std::make_unsigned_t<T> raw;
    std::memcpy(&raw, pixels.data() + at, sizeof(T));
    const T kept =
        static_cast<T>(static_cast<T>(static_cast<std::make_unsigned_t<T>>(raw << left)) >> right);
    std::memcpy(pixels.data() + at, &kept, sizeof(T));
  }
}

}  // namespace

Result<DicomSlice> read_dicom_header(const std::string& path) {
  const auto bytes = read_whole(path);
  if (!bytes) return tl::unexpected(bytes.error());
  const auto elements = parse_dicom(path, *bytes);
  if (!elements) return tl::unexpected(elements.error());
  DicomSlice slice;
  slice.path = path;
  if (!elements->values.contains(kRows)) {
    if (is_pictureless(*elements)) return slice;
    return fail(ErrorCode::bad_file, path,
                ": a DICOM file without Rows: it is truncated, or its "
                "kind (SOP class ",
                in_quotes(text_of(*elements, kSopClass)), ") holds no picture; move it elsewhere");
  }
  if (auto r = read_format(*elements, slice); !r) return tl::unexpected(r.error());
  if (auto r = read_place(*elements, slice); !r) return tl::unexpected(r.error());
  if (const auto slope = numbers_of(*elements, kRescaleSlope); !slope.empty() && slope[0] != 0)
    slice.slope = slope[0];
  if (const auto intercept = numbers_of(*elements, kRescaleIntercept); !intercept.empty())
    slice.intercept = intercept[0];
  slice.series = text_of(*elements, kSeriesInstanceUid);
  if (slice.series.empty()) slice.series = "(no SeriesInstanceUID)";
  return slice;
}

Result<std::vector<std::byte>> read_dicom_pixels(const DicomSlice& slice) {
  const auto bytes = read_whole(slice.path);
  if (!bytes) return tl::unexpected(bytes.error());
  const auto elements = parse_dicom(slice.path, *bytes);
  if (!elements) return tl::unexpected(elements.error());
  if (elements->compressed)
    return fail(ErrorCode::unsupported, slice.path, ": compressed pixels (transfer syntax ",
                elements->syntax, "); decompress the series first, `gdcmconv --raw IN OUT`");
  const auto found = elements->values.find(kPixelData);
  const std::string_view data = found == elements->values.end() ? "" : found->second;
  const std::size_t width = bytes_per_voxel(slice.type);
  const std::uint64_t needed = std::uint64_t{slice.width} * slice.height * width;
  if (data.size() < needed)
    return fail(ErrorCode::bad_file, slice.path, ": ", slice.height, "x", slice.width,
                " pixels of ", name(slice.type), " need ", needed, " bytes, PixelData holds ",
                data.size());
  const auto* from = reinterpret_cast<const std::byte*>(data.data());
  std::vector<std::byte> pixels(from, from + needed);
  if (std::endian::native == std::endian::big) swap_bytes(pixels, width);
  switch (slice.type) {
    case ScalarType::u8:
      keep_stored_bits<std::uint8_t>(pixels, slice);
      break;
    case ScalarType::i8:
      keep_stored_bits<std::int8_t>(pixels, slice);
      break;
    case ScalarType::u16:
      keep_stored_bits<std::uint16_t>(pixels, slice);
      break;
    case ScalarType::i16:
      keep_stored_bits<std::int16_t>(pixels, slice);
      break;
    case ScalarType::u32:
      keep_stored_bits<std::uint32_t>(pixels, slice);
      break;
    default:
      keep_stored_bits<std::int32_t>(pixels, slice);
  }
  return pixels;
}

}  // namespace slf::volume_io
