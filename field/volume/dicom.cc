// Converts the few relevant elements of a DICOM file to slices.
#include "field/volume/dicom.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include "base/bytes.h"
#include "field/volume/io.h"

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

std::string text_of(const DicomValues& values, Tag tag) {
  const auto found = values.find(tag);
  if (found == values.end()) return {};
  return std::string(trim(found->second.substr(0, found->second.find('\0'))));
}

/// Whether a file is of a kind that has no picture: a directory, report, structure set,
/// presentation state, document, waveform or raw data. Any other file without a picture is damaged.
bool has_no_picture(const DicomValues& values) {
  constexpr std::uint32_t kDirectoryRecords = 0x00041220;
  if (values.contains(kDirectoryRecords)) return true;
  const std::string sop_class = text_of(values, kSopClass);
  for (const auto* kind : {"88.", "481.", "11.", "104.", "9.", "66"})
    if (sop_class.starts_with(std::string("1.2.840.10008.5.1.4.1.1.").append(kind))) return true;
  return false;
}

/// Parses decimal strings separated by backslashes. Empty if they are missing or no numbers.
std::vector<double> numbers_of(const DicomValues& values, Tag tag) {
  std::vector<double> result;
  std::istringstream parts(text_of(values, tag));
  for (std::string part; std::getline(parts, part, '\\');) {
    const auto value = parse_number(part);
    if (!value || !std::isfinite(*value)) return {};
    result.push_back(*value);
  }
  return result;
}

unsigned integer_of(const DicomValues& values, Tag tag, unsigned otherwise) {
  const auto found = values.find(tag);
  if (found == values.end() || found->second.size() < 2) return otherwise;
  return load_le<std::uint16_t>(reinterpret_cast<const std::byte*>(found->second.data()));
}

struct Compression {
  std::string_view syntax, name;
};
constexpr std::array<Compression, 9> kCompressions = {{
    {"1.2.840.10008.1.2.4.50", "JPEG baseline"},
    {"1.2.840.10008.1.2.4.51", "JPEG extended"},
    {"1.2.840.10008.1.2.4.57", "JPEG lossless"},
    {"1.2.840.10008.1.2.4.70", "JPEG lossless, first order"},
    {"1.2.840.10008.1.2.4.80", "JPEG-LS lossless"},
    {"1.2.840.10008.1.2.4.81", "JPEG-LS"},
    {"1.2.840.10008.1.2.4.90", "JPEG 2000 lossless"},
    {"1.2.840.10008.1.2.4.91", "JPEG 2000"},
    {"1.2.840.10008.1.2.5", "RLE"},
}};

Result<void> read_encoding(const DicomElements& elements, DicomSlice& slice) {
  slice.syntax = elements.syntax;
  slice.compressed = elements.encapsulated;
  const bool known = !name_of_compression(slice.syntax).empty();
  if (slice.compressed && !known)
    return fail(ErrorCode::unsupported, slice.path, ": compressed pixels, transfer syntax ",
                in_quotes(slice.syntax), ", expected JPEG, JPEG-LS, JPEG 2000 or RLE");
  if (known && !slice.compressed && elements.values.contains(kPixelData))
    return fail(ErrorCode::bad_file, slice.path, ": expected pixels in fragments, ",
                name_of_compression(slice.syntax), ", found a plain element");
  return {};
}

Result<void> read_format(const DicomValues& values, DicomSlice& slice) {
  slice.height = integer_of(values, kRows, 0);
  slice.width = integer_of(values, kColumns, 0);
  if (slice.width == 0 || slice.height == 0)
    return fail(ErrorCode::bad_file, slice.path, ": Rows x Columns are ", slice.height, "x",
                slice.width);
  if (const auto samples = integer_of(values, kSamplesPerPixel, 1); samples != 1)
    return fail(ErrorCode::unsupported, slice.path, ": pixels of ", samples,
                " components (colour), expected one number each: extract one component");
  if (text_of(values, kPhotometric) == "PALETTE COLOR")
    return fail(ErrorCode::unsupported, slice.path, ": palette colours, expected grey values");
  const unsigned allocated = integer_of(values, kBitsAllocated, 0);
  slice.bits_stored = integer_of(values, kBitsStored, allocated);
  slice.high_bit = integer_of(values, kHighBit, slice.bits_stored - 1);
  if ((allocated != 8 && allocated != 16 && allocated != 32) || slice.bits_stored == 0 ||
      slice.high_bit >= allocated || slice.high_bit + 1 < slice.bits_stored)
    return fail(ErrorCode::unsupported, slice.path, ": pixels of ", slice.bits_stored,
                " bits up to bit ", slice.high_bit, " of ", allocated,
                ", expected 8, 16 or 32 allocated");
  const bool is_signed = integer_of(values, kPixelRepresentation, 0) == 1;
  slice.type = allocated == 8    ? (is_signed ? ScalarType::i8 : ScalarType::u8)
               : allocated == 16 ? (is_signed ? ScalarType::i16 : ScalarType::u16)
                                 : (is_signed ? ScalarType::i32 : ScalarType::u32);
  return {};
}

Result<void> read_place(const DicomValues& values, DicomSlice& slice) {
  const auto position = numbers_of(values, kPosition);
  const auto orientation = numbers_of(values, kOrientation);
  const auto spacing = numbers_of(values, kPixelSpacing);
  if (position.size() != 3 || orientation.size() != 6 || spacing.size() != 2)
    return fail(ErrorCode::bad_file, slice.label(),
                ": needs ImagePositionPatient (3 numbers, found ", position.size(),
                "), ImageOrientationPatient (6, found ", orientation.size(),
                ") and PixelSpacing (2, found ", spacing.size(), ") to be placed in space");
  slice.position = {position[0], position[1], position[2]};
  slice.row = {orientation[0], orientation[1], orientation[2]};
  slice.column = {orientation[3], orientation[4], orientation[5]};
  slice.spacing = {spacing[1], spacing[0]};  // the file states the one between rows first
  const double sine = glm::length(glm::cross(slice.row, slice.column));
  if (!(std::abs(sine - 1) < 1e-2) || !(std::abs(glm::length(slice.row) - 1) < 1e-2))
    return fail(ErrorCode::bad_file, slice.label(),
                ": ImageOrientationPatient is not two perpendicular unit vectors");
  if (!(slice.spacing.x > 0) || !(slice.spacing.y > 0))
    return fail(ErrorCode::bad_file, slice.label(), ": PixelSpacing is ", slice.spacing.y, " by ",
                slice.spacing.x, ", expected positive numbers");
  return {};
}

void read_scale(const DicomValues& values, DicomSlice& slice) {
  if (const auto slope = numbers_of(values, kRescaleSlope); !slope.empty() && slope[0] != 0)
    slice.slope = slope[0];
  if (const auto intercept = numbers_of(values, kRescaleIntercept); !intercept.empty())
    slice.intercept = intercept[0];
}

/// Makes one slice per frame. Values come from the frame's own functional groups, else from the
/// shared ones, else from the outermost data set.
Result<std::vector<DicomSlice>> split(const DicomElements& elements, const DicomSlice& file) {
  std::vector<DicomSlice> slices;
  for (std::uint32_t frame = 0; frame < file.frames; ++frame) {
    DicomValues values = elements.frames.empty() ? DicomValues{} : elements.frames[frame];
    for (const auto* outer : {&elements.shared, &elements.values})
      for (const auto tag :
           {kPosition, kOrientation, kPixelSpacing, kRescaleSlope, kRescaleIntercept})
        if (const auto found = outer->find(tag); found != outer->end()) values.insert(*found);
    DicomSlice& slice = slices.emplace_back(file);
    slice.frame = frame;
    if (auto r = read_place(values, slice); !r) return tl::unexpected(r.error());
    read_scale(values, slice);
  }
  return slices;
}

Result<void> count_frames(const DicomElements& elements, DicomSlice& slice) {
  const auto stated = numbers_of(elements.values, kFrames);
  const double frames = stated.empty() ? 1 : stated[0];
  if (frames > 1 && elements.frames.empty())
    return fail(ErrorCode::unsupported, slice.path, ": ", frames,
                " frames without positions (no functional groups); convert it, e.g. "
                "`dcm2niix FOLDER`");
  if (!elements.frames.empty() && frames != static_cast<double>(elements.frames.size()))
    return fail(ErrorCode::bad_file, slice.path, ": NumberOfFrames is ", frames, ", but ",
                elements.frames.size(), " frames have functional groups");
  slice.frames = static_cast<std::uint32_t>(std::max<std::size_t>(elements.frames.size(), 1));
  return {};
}

}  // namespace

std::uint64_t DicomSlice::bytes() const {
  return std::uint64_t{width} * height * bytes_per_voxel(type);
}

std::string DicomSlice::label() const {
  return frames == 1 ? path : path + " frame " + std::to_string(frame + 1);
}

std::string name_of_compression(std::string_view syntax) {
  for (const auto& known : kCompressions)
    if (known.syntax == syntax)
      return std::string(known.name) + " (transfer syntax " + std::string(syntax) + ")";
  return {};
}

Result<std::vector<DicomSlice>> read_dicom_slices(const std::string& path,
                                                  const std::optional<std::string>& series) {
  const auto bytes = read_dicom_bytes(path);
  if (!bytes) return tl::unexpected(bytes.error());
  const auto elements = parse_dicom(path, *bytes);
  if (!elements) return tl::unexpected(elements.error());
  const auto& values = elements->values;
  DicomSlice file;
  file.path = path;
  file.series = text_of(values, kSeriesInstanceUid);
  if (file.series.empty()) file.series = "(no SeriesInstanceUID)";
  if (series && file.series != *series) return std::vector<DicomSlice>{};
  if (!values.contains(kRows)) {
    if (has_no_picture(values)) return std::vector<DicomSlice>{};
    return fail(ErrorCode::bad_file, path,
                ": a DICOM file without Rows: it is truncated, or its "
                "kind (SOP class ",
                in_quotes(text_of(values, kSopClass)), ") holds no picture; move it elsewhere");
  }
  if (auto r = read_format(values, file); !r) return tl::unexpected(r.error());
  if (auto r = count_frames(*elements, file); !r) return tl::unexpected(r.error());
  if (auto r = read_encoding(*elements, file); !r) return tl::unexpected(r.error());
  return split(*elements, file);
}

}  // namespace slf::volume_io
