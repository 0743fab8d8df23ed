// Converts the few relevant elements of a DICOM file to slices.
#include "source/volume/dicom/dicom.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/try.h"
#include "source/volume/dicom/dicom_elements.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

enum Tag : DicomTag {
  kDirectoryRecords = 0x00041220,
  kImageType = 0x00080008,
  kSopClass = 0x00080016,
  kSopInstance = 0x00080018,
  kAcquisitionDate = 0x00080022,
  kContentDate = 0x00080023,
  kAcquisitionDateTime = 0x0008002a,
  kAcquisitionTime = 0x00080032,
  kContentTime = 0x00080033,
  kModality = 0x00080060,
  kSeriesDescription = 0x0008103e,
  kFrameType = 0x00089007,
  kComplexComponent = 0x00089208,
  kKvp = 0x00180060,
  kRepetitionTime = 0x00180080,
  kEchoTime = 0x00180081,
  kInversionTime = 0x00180082,
  kEchoNumbers = 0x00180086,
  kSpacingBetweenSlices = 0x00180088,
  kTriggerTime = 0x00181060,
  kFlipAngle = 0x00181314,
  kInversionTimes = 0x00189079,
  kBValue = 0x00189087,
  kGradientDirection = 0x00189089,
  kFrameAcquisitionDateTime = 0x00189074,
  kEffectiveEchoTime = 0x00189082,
  kFrameReferenceDateTime = 0x00189151,
  kSeriesInstanceUid = 0x0020000e,
  kSeriesNumber = 0x00200011,
  kAcquisitionNumber = 0x00200012,
  kInstanceNumber = 0x00200013,
  kPosition = 0x00200032,
  kOrientation = 0x00200037,
  kTemporalPosition = 0x00200100,
  kSliceLocation = 0x00201041,
  kStackId = 0x00209056,
  kInStackPosition = 0x00209057,
  kTemporalIndex = 0x00209128,
  kTriggerDelay = 0x00209153,
  kFrameAcquisitionNumber = 0x00209156,
  kDimensionValues = 0x00209157,
  kDimensionPointer = 0x00209165,
  kDimensions = 0x00209222,
  kCardiacPhase = 0x00209241,
  kRespiratoryPhase = 0x00209245,
  kPositionSequence = 0x00209113,
  kVolumePosition = 0x00209301,
  kVolumeOrientation = 0x00209302,
  kTimeOffset = 0x0020930d,
  kSamplesPerPixel = 0x00280002,
  kPhotometric = 0x00280004,
  kPlanarConfiguration = 0x00280006,
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
  kRescaleType = 0x00281054,
  kModalityLut = 0x00283000,
  kLutDescriptor = 0x00283002,
  kLutData = 0x00283006,
  kPaletteDescriptor = 0x00281101,  // red; green and blue follow
  kPaletteData = 0x00281201,        // likewise
  kMatrixColumns = 0x00480006,
  kReferenceTime = 0x00541300,
  kDetectors = 0x00540022,
  kSegmentNumber = 0x00620004,
  kReferencedSegment = 0x0062000b,
  kFrameOffsets = 0x3004000c,
  kUnits = 0x00541001,  // of PET
  kDoseUnits = 0x30040002,
  kDoseScale = 0x3004000e,
  kSharedGroups = 0x52009229,
  kFrameGroups = 0x52009230,
  kFloatPixels = 0x7fe00008,
  kDoublePixels = 0x7fe00009,
};

/// Whether a file is of a kind that has no picture: a directory, report, structure set,
/// presentation state, document, waveform or raw data. Any other file without a picture is damaged.
bool has_no_picture(const DicomLookup& file) {
  if (!file.raw(kDirectoryRecords).empty()) return true;
  const std::string sop_class = file.text(kSopClass);
  for (const auto* kind : {"88.", "481.", "11.", "104.", "9.", "66"})
    if (sop_class.starts_with(std::string("1.2.840.10008.5.1.4.1.1.").append(kind))) return true;
  return sop_class == "1.2.840.10008.1.3.10";
}

/// The transfer syntaxes of compressions that are decoded, and their names.
constexpr std::array<std::pair<std::string_view, std::string_view>, 9> kCompressions = {{
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

Result<void> read_encoding(const DicomFile& file, DicomSlice& slice) {
  slice.syntax = file.syntax;
  slice.compressed = file.encapsulated;
  const bool known = !name_of_compression(slice.syntax).empty();
  if (slice.compressed && !known)
    return unsupported(slice.path, "compressed pixels, transfer syntax ", in_quotes(slice.syntax),
                       ", expected JPEG, JPEG-LS, JPEG 2000 or RLE");
  if (slice.compressed && slice.one_bit)
    return unsupported(slice.path, "pixels of 1 bit, compressed by ",
                       name_of_compression(slice.syntax), ", expected plain ones");
  if (known && !slice.compressed && file.data.values.contains(slice.pixels_at))
    return bad_file(slice.path, "expected pixels in fragments, ", name_of_compression(slice.syntax),
                    ", found a plain element");
  if (file.big_endian && !slice.one_bit)
    slice.swapped =
        std::max<unsigned>(static_cast<unsigned>(bytes_per_voxel(slice.type)), file.words ? 2 : 1);
  return {};
}

/// Appends a channel to the slice's palette, as PS3.3 C.7.6.3.1.5 and C.11.1 have it.
Result<void> read_table(const DicomLookup& file, DicomTag descriptor, DicomTag content,
                        DicomPalette& palette, const DicomSlice& slice) {
  const auto layout = file.integers(descriptor, 2);
  if (layout.size() != 3 || layout[2] < 8 || layout[2] > 16)
    return unsupported(slice.path,
                       "a table of colours or values, but none of 8 to 16 bits: "
                       "convert it to a file without one");
  const std::size_t count = layout[0] == 0 ? 65536 : layout[0];
  // Tables of 8 bits have one byte an entry, or, in old files, two.
  const auto data = file.raw(content);
  const bool bytes = layout[2] == 8 && data.size() < 2 * count;
  if (data.size() < count * (bytes ? 1 : 2))
    return bad_file(slice.path, "a table of ", count, " entries has ", data.size(),
                    " bytes, or is stored in segments");
  auto& values = palette.channels.emplace_back();
  if (bytes)
    for (const char c : data.substr(0, count)) values.push_back(static_cast<std::uint8_t>(c));
  else
    for (const auto v : file.integers(content, 2)) values.push_back(static_cast<std::uint16_t>(v));
  values.resize(count);
  if (values.size() != palette.channels.front().size())
    return bad_file(slice.path, "palettes of ", palette.channels.front().size(), " and ",
                    values.size(), " entries, expected equal ones");
  const bool is_signed = slice.type == ScalarType::i8 || slice.type == ScalarType::i16;
  palette.first = is_signed ? static_cast<std::int16_t>(layout[1]) : static_cast<int>(layout[1]);
  palette.wide = layout[2] > 8;
  return {};
}

Result<void> read_palette(const DicomLookup& file, DicomSlice& slice) {
  auto palette = std::make_shared<DicomPalette>();
  for (DicomTag channel = 0; channel < 3; ++channel)
    SLF_TRY(
        read_table(file, kPaletteDescriptor + channel, kPaletteData + channel, *palette, slice));
  slice.palette = std::move(palette);
  return {};
}

/// The Modality LUT gives the values of a grey picture; in X-ray projections it is for display.
Result<void> read_values(const DicomFile& file, const DicomLookup& values, DicomSlice& slice) {
  const auto& tables = file.data.items(kModalityLut);
  if (tables.empty() || slice.samples != 1 || slice.palette ||
      values.text(kSopClass).starts_with("1.2.840.10008.5.1.4.1.1.12.") || slice.modality == "XA" ||
      slice.modality == "RF")
    return {};
  auto palette = std::make_shared<DicomPalette>();
  const DicomLookup table(file.big_endian, {&tables.front()});
  SLF_TRY(read_table(table, kLutDescriptor, kLutData, *palette, slice));
  slice.palette = std::move(palette);
  return {};
}

Result<void> read_color(const DicomLookup& file, DicomSlice& slice) {
  slice.samples = file.integer(kSamplesPerPixel).value_or(1);
  slice.planar = file.integer(kPlanarConfiguration).value_or(0) == 1 && slice.samples > 1;
  const std::string color = file.text(kPhotometric);
  if (color == "PALETTE COLOR" && slice.samples == 1) {
    slice.color = DicomColor::palette;
    return read_palette(file, slice);
  }
  slice.least_is_white = color == "MONOCHROME1";
  if (slice.samples == 1) return {};
  slice.color = color == "YBR_FULL"       ? DicomColor::ybr_full
                : color == "YBR_FULL_422" ? DicomColor::ybr_full_422
                                          : DicomColor::rgb;
  const bool known =
      slice.color != DicomColor::rgb || color == "RGB" || color == "YBR_RCT" || color == "YBR_ICT";
  const bool ybr = slice.color != DicomColor::rgb;
  if (slice.samples != 3 || !known || (ybr && bytes_per_voxel(slice.type) != 1))
    return unsupported(slice.path, "pixels of ", slice.samples,
                       " components, photometric interpretation ", in_quotes(color),
                       ", expected grey, RGB, YBR_FULL or a palette: convert it to RGB");
  return {};
}

Result<void> read_format(const DicomLookup& file, DicomSlice& slice) {
  slice.height = file.integer(kRows).value_or(0);
  slice.width = file.integer(kColumns).value_or(0);
  if (slice.width == 0 || slice.height == 0 || (slice.width | slice.height) > 0xffff)
    return bad_file(slice.path, "Rows x Columns are ", slice.height, "x", slice.width);
  if (const auto whole = file.integer(kMatrixColumns); whole && *whole > slice.width)
    return unsupported(slice.path, "tiles of a microscope's slide, expected slices of a volume");
  slice.pixels_at = kPixelData;
  for (const auto& [tag, type] :
       {std::pair{kFloatPixels, ScalarType::f32}, std::pair{kDoublePixels, ScalarType::f64}})
    if (!file.raw(tag).empty()) {
      slice.pixels_at = tag;
      slice.type = type;
      slice.bits_stored = static_cast<unsigned>(8 * bytes_per_voxel(type));
      slice.high_bit = slice.bits_stored - 1;
      return {};
    }
  const auto stated = file.integer(kBitsAllocated);
  if (!stated) return bad_file(slice.path, "BitsAllocated is missing");
  const unsigned allocated = *stated;
  slice.bits_stored = file.integer(kBitsStored).value_or(allocated);
  slice.high_bit = file.integer(kHighBit).value_or(std::max(slice.bits_stored, 1u) - 1);
  slice.one_bit = allocated == 1;
  const unsigned bits = slice.one_bit ? 8 : allocated;
  if (slice.one_bit) slice.bits_stored = 8, slice.high_bit = 7;
  if ((bits != 8 && bits != 16 && bits != 32) || slice.bits_stored == 0 || slice.high_bit >= bits ||
      slice.high_bit + 1 < slice.bits_stored)
    return unsupported(slice.path, "BitsAllocated is ", allocated, ", BitsStored ",
                       slice.bits_stored, " and HighBit ", slice.high_bit,
                       ", expected 1, 8, 16 or 32 allocated, and as many or fewer stored");
  const bool is_signed = file.integer(kPixelRepresentation).value_or(0) == 1;
  slice.type = bits == 8    ? (is_signed ? ScalarType::i8 : ScalarType::u8)
               : bits == 16 ? (is_signed ? ScalarType::i16 : ScalarType::u16)
                            : (is_signed ? ScalarType::i32 : ScalarType::u32);
  return read_color(file, slice);
}

/// Numbers that can be places; none if one is absurd, so that sums of them stay finite.
std::vector<double> lengths(std::vector<double> values) {
  constexpr double kMost = 1e9;
  const bool absurd = std::ranges::any_of(values, [](double v) { return !(std::abs(v) <= kMost); });
  return absurd ? std::vector<double>{} : values;
}

std::optional<double> length(const std::vector<double>& values) {
  const auto sane = lengths(values);
  return sane.empty() ? std::nullopt : std::optional(sane.front());
}

Result<void> read_place(const DicomLookup& values, DicomSlice& slice) {
  // Volumes in a frame of their own (ultrasound) have binary ones.
  const auto either = [&](Tag tag, Tag binary) {
    const auto found = values.numbers(tag);
    return lengths(found.empty() ? values.reals(binary) : found);
  };
  const auto position = either(kPosition, kVolumePosition);
  const auto orientation = either(kOrientation, kVolumeOrientation);
  const auto spacing = lengths(values.numbers(kPixelSpacing));
  if (spacing.size() == 2 && spacing[0] > 0 && spacing[1] > 0)
    slice.spacing = {spacing[1], spacing[0]};  // the file states the one between rows first
  slice.location = length(values.numbers(kSliceLocation));
  slice.stated_gap = std::abs(length(values.numbers(kSpacingBetweenSlices)).value_or(0));
  if (orientation.size() == 6) {
    slice.row = {orientation[0], orientation[1], orientation[2]};
    slice.column = {orientation[3], orientation[4], orientation[5]};
    const double sine = glm::length(glm::cross(slice.row, slice.column));
    if (!(std::abs(sine - 1) < 1e-2) || !(std::abs(glm::length(slice.row) - 1) < 1e-2))
      return bad_file(slice.label(),
                      "ImageOrientationPatient is not two perpendicular unit vectors");
  }
  if (position.size() == 3) slice.position = {position[0], position[1], position[2]};
  slice.placed = position.size() == 3 && orientation.size() == 6;
  for (const auto& [missing, what] : {std::pair{position.size() != 3, "ImagePositionPatient"},
                                      {orientation.size() != 6, "ImageOrientationPatient"}})
    if (missing) slice.unplaced += (slice.unplaced.empty() ? "" : " and ") + std::string(what);
  return {};
}

void read_scale(const DicomLookup& values, DicomSlice& slice) {
  if (const auto slope = values.number(kRescaleSlope); slope && *slope != 0) slice.slope = *slope;
  if (const auto dose = values.number(kDoseScale); dose && *dose != 0) slice.slope = *dose;
  if (const auto intercept = values.number(kRescaleIntercept)) slice.intercept = *intercept;
  for (const DicomTag tag : {kRescaleType, kUnits, kDoseUnits})
    if (slice.value_unit.empty()) slice.value_unit = values.text(tag);
  // Of a CT that says nothing, PS 3.3 C.8.2.1.1.6; US is "unspecified".
  if (slice.value_unit.empty() && slice.modality == "CT") slice.value_unit = "HU";
  if (slice.value_unit == "US") slice.value_unit.clear();
}

/// Which dimensions of a multi-frame file are not places in space.
std::vector<bool> other_dimensions(const DicomFile& file) {
  std::vector<bool> other;
  for (const auto& item : file.data.items(kDimensions)) {
    const auto halves = DicomLookup(file.big_endian, {&item}).integers(kDimensionPointer, 2);
    const DicomTag tag = halves.size() == 2 ? halves[0] << 16 | halves[1] : 0;
    constexpr std::array<DicomTag, 8> kOfSpace = {
        kStackId,        kInStackPosition, kPosition,      kPositionSequence,
        kVolumePosition, kSliceLocation,   kSegmentNumber, kReferencedSegment};
    other.push_back(std::ranges::find(kOfSpace, tag) == kOfSpace.end());
  }
  return other;
}

void read_moments(const DicomLookup& values, const std::vector<bool>& other_dimensions,
                  DicomSlice& slice) {
  const auto dimensions = values.integers(kDimensionValues, 4);
  if (dimensions.size() == other_dimensions.size())
    for (std::size_t i = 0; i < dimensions.size(); ++i)
      if (other_dimensions[i]) slice.indices.push_back(dimensions[i]);
  const auto first = [](std::initializer_list<std::optional<double>> candidates) {
    for (const auto& candidate : candidates)
      if (candidate) return *candidate;
    return -std::numeric_limits<double>::infinity();
  };
  const auto moment = [&](DicomTag tag) {  // without the time zone
    const std::string date = values.text(tag);
    return parse_number(date.substr(0, date.find_first_of("+-")));
  };
  slice.moments = {
      // as in kDicomMoments
      first({values.integer(kTemporalIndex), values.number(kTemporalPosition)}),
      first({values.real(kTimeOffset)}),
      first(
          {values.real(kEffectiveEchoTime), values.number(kEchoTime), values.number(kEchoNumbers)}),
      first({values.real(kInversionTimes), values.number(kInversionTime)}),
      first({values.number(kFlipAngle)}),
      first({values.real(kBValue)}),
      first({values.real(kTriggerDelay), values.number(kTriggerTime)}),
      first({values.real(kCardiacPhase)}),
      first({values.real(kRespiratoryPhase)}),
      first({values.number(kReferenceTime), moment(kFrameReferenceDateTime)}),
      first({values.integer(kFrameAcquisitionNumber), values.number(kAcquisitionNumber)}),
      first({values.number(kAcquisitionDate), values.number(kContentDate)}),
      first({moment(kFrameAcquisitionDateTime), values.number(kAcquisitionTime),
             values.number(kContentTime)}),
      first({moment(kAcquisitionDateTime)}),
      first({values.number(kInstanceNumber)}),
      first({slice.frame})};
  slice.traits.clear();
  for (const Tag tag :
       {kImageType, kFrameType, kComplexComponent, kGradientDirection, kRepetitionTime, kKvp})
    slice.traits.append(values.raw(tag)).push_back('\n');
}

/// Places the frames of a file without functional groups: a dose, whose frames have offsets, or a
/// nuclear medicine tomogram, whose frames follow each other at a stated distance.
void place_along_normal(const DicomLookup& file, DicomSlice& slice) {
  const auto offsets = lengths(file.numbers(kFrameOffsets));
  const auto gap = length(file.numbers(kSpacingBetweenSlices));
  const bool tomogram = file.text(kImageType).find("TOMO") != std::string::npos;
  const glm::dvec3 normal = glm::cross(slice.row, slice.column);
  if (slice.placed && offsets.size() == slice.frames)
    slice.position += normal * (offsets[slice.frame] - offsets[0]);
  else if (slice.placed && tomogram && gap && *gap != 0)
    slice.position += normal * (*gap * slice.frame);
  else
    slice.unplaced = "PlanePositionSequence", slice.placed = false;
}

/// Makes one slice per frame. Values come from the frame's own functional groups, else from the
/// shared ones, else from the outermost data set.
Result<std::vector<DicomSlice>> split(const DicomFile& file, const DicomSlice& whole) {
  DicomDataSet shared;
  for (const auto tag : {kSharedGroups, kDetectors})
    for (const auto& item : file.data.items(tag)) flatten(item, shared);
  const auto& groups = file.data.items(kFrameGroups);
  const auto dimensions = other_dimensions(file);
  std::vector<DicomSlice> slices;
  for (std::uint32_t frame = 0; frame < whole.frames; ++frame) {
    DicomDataSet own;
    if (!groups.empty()) flatten(groups[frame], own);
    const DicomLookup values(file.big_endian, {&own, &shared, &file.data});
    DicomSlice& slice = slices.emplace_back(whole);
    slice.frame = frame;
    SLF_TRY(read_place(values, slice));
    if (groups.empty() && whole.frames > 1) place_along_normal(values, slice);
    read_scale(values, slice);
    read_moments(values, dimensions, slice);
    slice.stack = values.text(kStackId);
    slice.segment = values.integer(kReferencedSegment).value_or(0);
  }
  return slices;
}

Result<void> count_frames(const DicomFile& file, const DicomLookup& values, DicomSlice& slice) {
  const double frames = std::max(values.number(kFrames).value_or(1), 1.0);
  const auto groups = file.data.items(kFrameGroups).size();
  if (groups > 0 && frames != static_cast<double>(groups))
    return bad_file(slice.path, "NumberOfFrames is ", frames, ", but ", groups,
                    " frames have functional groups");
  if (frames != std::trunc(frames) || frames > 1e6)
    return bad_file(slice.path, "NumberOfFrames is ", frames, ", expected a count up to 1000000");
  if (slice.compressed && frames > static_cast<double>(file.fragments))
    return bad_file(slice.path, frames, " frames, but its pixels have ", file.fragments,
                    " fragments");
  slice.frames = static_cast<std::uint32_t>(frames);
  const auto found = values.raw(slice.pixels_at).size();
  if (!slice.compressed && found < slice.file_bytes())
    return bad_file(slice.path, slice.frames, " frames of ", slice.height, "x", slice.width,
                    " pixels of ", slice.one_bit ? "1 bit" : name(slice.type), " need ",
                    slice.file_bytes(), " bytes, PixelData holds ", found);
  return {};
}

Result<std::vector<DicomSlice>> read_picture(const DicomFile& file, const DicomLookup& values,
                                             DicomSlice slice) {
  if (file.damage) return tl::unexpected(*file.damage);
  // The frames of an enhanced file have places of their own, whatever words its ImageType has.
  if (file.data.items(kSharedGroups).empty() && file.data.items(kFrameGroups).empty() &&
      values.text(kImageType).find("MOSAIC") != std::string::npos)
    return unsupported(
        slice.path,
        "a mosaic, whose one picture holds all slices: convert it, e.g. `dcm2niix FOLDER`");
  SLF_TRY(read_format(values, slice));
  SLF_TRY(read_encoding(file, slice));
  SLF_TRY(read_values(file, values, slice));
  SLF_TRY(count_frames(file, values, slice));
  SLF_TRY(read_segments(file, values, slice));
  if (slice.segmentation) slice.keep_indices();
  return split(file, slice);
}

}  // namespace

std::uint64_t DicomSlice::bytes() const {
  const std::uint64_t pixels = std::uint64_t{width} * height;
  if (one_bit) return (pixels + 7) / 8;
  // Plain, two pixels of YBR_FULL_422 share their chroma.
  if (color == DicomColor::ybr_full_422 && !compressed) return (pixels + 1) / 2 * 4;
  return pixels * samples * bytes_per_voxel(type);
}

std::uint64_t DicomSlice::file_bytes() const {
  if (one_bit) return (std::uint64_t{width} * height * frames + 7) / 8;
  return bytes() * frames;
}

std::uint32_t DicomSlice::components() const {
  return palette ? static_cast<std::uint32_t>(palette->channels.size()) : samples;
}

void DicomSlice::keep_indices() {
  if (color != DicomColor::palette) return;
  color = DicomColor::grey;
  palette.reset();
}

ScalarType DicomSlice::component_type() const {
  return !palette ? type : palette->wide ? ScalarType::u16 : ScalarType::u8;
}

std::string DicomSlice::label() const {
  return frames == 1 ? path : path + " frame " + std::to_string(frame + 1);
}

std::string name_of_compression(std::string_view syntax) {
  for (const auto& [known, name] : kCompressions)
    if (known == syntax) return concat(name, " (transfer syntax ", syntax, ")");
  return {};
}

Result<std::vector<DicomSlice>> read_dicom_slices(const std::string& path) {
  const auto bytes = SLF_TRY(read_dicom_bytes(path));
  DicomFile file = parse_dicom(path, bytes);
  const DicomLookup values(file.big_endian, {&file.data});
  if (values.raw(kRows).empty() && !file.damage) {
    if (has_no_picture(values)) return std::vector<DicomSlice>{};
    file.damage =
        bad_file(path, "a DICOM file without Rows: it is truncated, or its kind (SOP class ",
                 in_quotes(values.text(kSopClass)), ") holds no picture; move it elsewhere")
            .value();
  }
  DicomSlice slice;
  slice.path = path;
  slice.series = values.text(kSeriesInstanceUid);
  if (slice.series.empty() && file.damage) return tl::unexpected(*file.damage);
  if (slice.series.empty()) slice.series = "(no SeriesInstanceUID)";
  slice.number = values.text(kSeriesNumber);
  slice.description = values.utf8(kSeriesDescription, values.text(kCharacterSet));
  slice.modality = values.text(kModality);
  slice.instance = values.text(kSopInstance);
  auto slices = read_picture(file, values, slice);
  if (slices) return slices;
  (void)read_place(values, slice);  // to know whether the volume lacks it
  slice.problem = slices.error();
  return std::vector{slice};
}

}  // namespace slf::volume_io
