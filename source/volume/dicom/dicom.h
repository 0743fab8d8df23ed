// DICOM slices: the frames of files, with their positions, scales and pixels.
//
// Our own parser (dicom_elements.h) reads elements, positions and uncompressed pixels, in this
// process. GDCM decodes compressed pixels, but only in a child process (DicomDecoder), and only
// after our parser has accepted the file.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slf/error.h"
#include "slf/volume.h"

namespace slf::volume_io {

/// How the samples of a pixel are to be understood.
enum class DicomColor : std::uint8_t { grey, rgb, ybr_full, ybr_full_422, palette };

/// A table of colours, or of values, for the stored values from `first` on.
struct DicomPalette {
  int first = 0;
  bool wide = false;  ///< 16 bits a channel, else 8
  /// Red, green and blue, or one of values; of the same length, at least 1.
  std::vector<std::vector<std::uint16_t>> channels{};
};

/// What a segmentation (SEG) says of its frames.
struct DicomSegmentation {
  enum class Kind : std::uint8_t { binary, fractional, label_map } kind = Kind::binary;
  std::uint32_t maximum = 1;  ///< the value of a fractional frame that means all
  LabelTable segments{};      ///< names and colours by number
};

/// What tells apart the slices at one place, in the order in which it does.
inline constexpr auto kDicomMoments = std::to_array<std::string_view>(
    {"TemporalPosition", "TemporalPositionTimeOffset", "EchoTime", "InversionTime", "FlipAngle",
     "DiffusionBValue", "TriggerTime", "CardiacPhase", "RespiratoryPhase", "FrameReferenceTime",
     "AcquisitionNumber", "AcquisitionDate", "AcquisitionTime", "AcquisitionDateTime",
     "InstanceNumber", "frame"});
inline constexpr std::size_t kInstanceMoment =
    kDicomMoments.size() - 2;  // it and those behind it only number slices

/// The position of a slice, and how its pixels are stored and scaled.
struct DicomSlice {
  std::string path;
  std::uint32_t frame = 0, frames = 1;  ///< its frame, and how many the file has

  std::string series, number, description, modality;   ///< number: text, may be empty
  std::string instance;                                ///< SOPInstanceUID
  std::string stack;                                   ///< StackID
  std::vector<std::uint32_t> indices{};                ///< of dimensions other than space
  std::array<double, kDicomMoments.size()> moments{};  ///< minus infinity: not stated
  std::string traits{};  ///< what else tells slices apart, but is no number: directions, kinds

  std::string syntax;           ///< transfer syntax UID
  bool compressed = false;      ///< needs GDCM
  unsigned swapped = 1;         ///< bytes of the big-endian words that pixels are stored in, or 1
  std::uint32_t pixels_at = 0;  ///< tag of the pixel data

  bool placed = false;     ///< whether position and directions are the file's
  std::string unplaced{};  ///< else: the elements it lacks
  glm::dvec3 position{0.0};
  glm::dvec3 row{1, 0, 0}, column{0, 1, 0};  ///< world directions of the picture's x and y
  glm::dvec2 spacing{0.0};                   ///< along row, along column; 0: not stated
  std::optional<double> location{};          ///< SliceLocation
  double stated_gap = 0;                     ///< SpacingBetweenSlices; 0: not stated
  double slope = 1, intercept = 0;
  std::string value_unit{};  ///< of values; empty: not stated
  std::uint32_t width = 0, height = 0;
  ScalarType type = ScalarType::u8;  ///< of a sample as stored
  unsigned bits_stored = 8, high_bit = 7;
  bool one_bit = false;       ///< eight pixels a byte, frames without gaps
  std::uint32_t samples = 1;  ///< numbers stored per pixel
  bool planar = false;        ///< one plane per sample
  DicomColor color = DicomColor::grey;
  bool least_is_white = false;  ///< MONOCHROME1
  std::shared_ptr<const DicomPalette> palette{};
  std::shared_ptr<const DicomSegmentation> segmentation{};
  std::uint32_t segment = 0;  ///< of binary and fractional segmentations

  /// Why its pixels cannot be read.
  std::optional<Error> problem{};

  /// Bytes of its pixels, decoded, rounded up. At most 2^37.
  [[nodiscard]] std::uint64_t bytes() const;
  /// Bytes of the pixels of all frames of its file.
  [[nodiscard]] std::uint64_t file_bytes() const;
  /// Reads the indices of a palette, not its colours.
  void keep_indices();
  /// Numbers per pixel once read: a palette's indices become three.
  [[nodiscard]] std::uint32_t components() const;
  /// Their type.
  [[nodiscard]] ScalarType component_type() const;
  /// The path and, if the file has several frames, the frame, for messages.
  [[nodiscard]] std::string label() const;
};

/// The name of a compression, as "JPEG 2000 (transfer syntax 1.2.840.10008.1.2.4.91)"; empty for
/// one that we cannot decode.
[[nodiscard]] std::string name_of_compression(std::string_view syntax);

/// The slices of a file, one per frame, in file order. None if the file is DICOM but no picture (a
/// DICOMDIR, a report). What prevents reading their pixels is in `problem`.
/// io, bad_file: not DICOM, or so damaged that not even a series is named.
[[nodiscard]] Result<std::vector<DicomSlice>> read_dicom_slices(const std::string& path);

struct DicomFile;
class DicomLookup;

/// Sets what a segmentation says of its frames; nothing for other files. `values`: the elements of
/// the file. unsupported: another kind of segmentation.
[[nodiscard]] Result<void> read_segments(const DicomFile& file, const DicomLookup& values,
                                         DicomSlice& slice);

/// One volume, or several time points of it: slices of a series that are alike.
struct DicomStack {
  std::string id;                  ///< how it is chosen
  std::vector<DicomSlice> slices;  ///< at least one
  std::vector<std::string> notes{};
};

/// The slices of a stack by place, and at each place by time.
struct DicomPlaces {
  /// Ascending along the normal; all places have as many slices as there are times.
  std::vector<std::vector<DicomSlice>> places{};
  std::vector<std::string>
      times{};  ///< what tells each time apart, as "EchoTime 4.9"; may be empty
  std::vector<std::string> notes{};
  [[nodiscard]] std::size_t time_count() const { return places.front().size(); }
};

/// What distinguishes slices that cannot belong to one volume, as "orientation"; null if they can.
[[nodiscard]] const char* difference(const DicomSlice& a, const DicomSlice& b);

/// Sorts the slices of a stack by place and time. Copies of a slice are left out with a note.
/// `spacing`, if given, replaces what the files lack.
/// bad_file, unsupported: a problem of the slices themselves; slices that differ or lie at the same
/// place;
/// places that lack a time; no position.
[[nodiscard]] Result<DicomPlaces> sort_by_place(const DicomStack& stack,
                                                const std::optional<glm::dvec3>& spacing);

/// The place of a slice along its normal.
[[nodiscard]] double height_of(const DicomSlice& slice);

/// Evenly spaced planes, some of which may have no slice: files of labels leave out empty ones.
struct PlaneGrid {
  std::size_t count = 0;
  std::vector<std::size_t> plane{};   ///< of each slice
  glm::dvec3 origin{0.0}, step{0.0};  ///< oblique, with a tilted gantry
  bool uneven = false;  ///< the slices are not: `step` is the smallest distance of two
};
/// The planes at the stated distance or, if slices lie between these, at the smallest one found.
/// bad_file: slices lie at other places. REQUIRES: at least one slice.
[[nodiscard]] Result<PlaneGrid> grid_of_planes(const std::vector<DicomSlice>& slices,
                                               const std::string& source);
/// Sets the volume's dims, axes and origin. `first`: one of the slices. Errors as check_dims() and
/// check_axes().
[[nodiscard]] Result<void> place_in(const PlaneGrid& grid, const DicomSlice& first, Volume& volume);

/// Calls `visit` with the index and the pixels of each slice, ordered by file: width × height
/// pixels of components() × component_type(), in native byte order, before slope and intercept.
/// Bits that are not stored are cleared, and the sign is extended. Colours are red, green, blue.
/// The values of MONOCHROME1 (least is white) do not change. bad_file: too few pixels, or
/// compressed ones that cannot be decoded. Others as those of `visit`.
[[nodiscard]] Result<void> for_each_frame(
    const std::vector<DicomSlice>& slices,
    const std::function<Result<void>(std::size_t, const std::vector<std::byte>&)>& visit);

/// Reads a stack as a volume. `source` is the path that was asked for.
[[nodiscard]] Result<Volume> read_dicom_stack(const std::string& source, const DicomStack& stack,
                                              const VolumeOptions& options);

/// Reads a binary or fractional segmentation as labels: its segments' numbers. A voxel of several
/// segments belongs to the one with the largest fraction, then to the highest number. Fractions
/// below one half belong to none.
[[nodiscard]] Result<Volume> read_segmentation(const std::string& source, const DicomStack& stack,
                                               const VolumeOptions& options);

}  // namespace slf::volume_io
