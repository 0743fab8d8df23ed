// Volume: a 3D scalar image in world coordinates, and its readers.
//
// World coordinates are millimetres (or whatever unit the file is in). Of a file that states the
// patient's axes they are in the LPS convention of DICOM and ITK: +x to the patient's left, +y to
// the back, +z to the head. NIfTI files, which are RAS, have x and y negated, so the same scan
// gives the same world in every format and a left hand stays a left hand.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "slf/error.h"

namespace slf {

enum class ScalarType : std::uint8_t { u8, i8, u16, i16, u32, i32, u64, i64, f32, f64 };

[[nodiscard]] const char* name(ScalarType type);
[[nodiscard]] std::size_t bytes_per_voxel(ScalarType type);

/// A type by any of its usual names, in any case: "u8", "uint8", "uint8_t", "uchar", "unsigned
/// char", and likewise for others. usage: unknown; the message lists the short names.
[[nodiscard]] Result<ScalarType> parse_scalar_type(std::string_view text);

/// How one structure is shown.
struct LabelStyle {
  std::string name{};
  std::optional<glm::dvec3> color;  ///< sRGB, 0 to 1; none: as the transfer function has it
  double opacity = 1;               ///< factor of the transfer function's opacity, 0 to 1

  bool operator==(const LabelStyle&) const = default;
};

/// Styles by id.
using LabelTable = std::map<std::int64_t, LabelStyle>;

/// Voxels as stored in the file (8 and 16 bits stay so), x fastest, then y, then z.
struct Volume {
  std::array<std::uint32_t, 3> dims{};
  ScalarType type = ScalarType::u8;
  std::vector<std::byte> voxels{};  ///< native endian, dims product × bytes_per_voxel(type)
  /// Instead of `voxels`, which is then empty: the same bytes where the program has them already,
  /// aligned to their type. They must not change as long as a copy of this pointer exists. Readers
  /// leave it null.
  std::shared_ptr<const std::byte> borrowed{};
  /// The value of a voxel is slope × stored + intercept (scl_slope, RescaleSlope).
  double slope = 1;
  double intercept = 0;
  /// World position of the centre of voxel (i,j,k) is origin + axes · (i,j,k): the columns of
  /// `axes` are the unit axis directions times the spacing. Never singular.
  glm::dmat3 axes{1.0};
  glm::dvec3 origin{0.0};
  /// Whether values are ids, which must not be interpolated, rather than amounts.
  bool labels = false;
  LabelTable label_styles{};  ///< names and colours of ids, if the file has them (DICOM SEG)
  std::string source{};       ///< the path it was read from, for messages and provenance
  /// Fields do not keep its name: of DICOM, it is often that of a patient, or a UID.
  bool private_name = false;
  /// Whether the file says where left, back and head are. Otherwise the axes of the world are x, y
  /// and z of the file, and mean nothing else.
  bool patient_axes = false;
  /// All files it was read from, headers and data. Scene::files() lists them, so that no build
  /// replaces one; add others that matter, such as that of a transfer function.
  std::vector<std::string> files{};
  std::string unit{};        ///< of world coordinates: "mm", "µm", "Å", …; empty: not stated
  std::string value_unit{};  ///< of values: "HU", "BQML", …; empty: not stated
  /// If the format has several ways to state the position: the one that was used, such as
  /// "sform (code 4)"; else empty.
  std::string placement{};
  /// Decisions of the reader that a person may want to check, one line each.
  std::vector<std::string> notes{};

  /// The bytes of the voxels: `borrowed` or `voxels`.
  [[nodiscard]] std::span<const std::byte> bytes() const;
  /// Makes the voxels `borrowed`, so that copies share them.
  void share();
  [[nodiscard]] glm::dvec3 spacing() const;
  [[nodiscard]] std::uint64_t voxel_count() const;
  /// Least and greatest finite value, after slope and intercept.
  [[nodiscard]] std::array<double, 2> value_range() const;
};

/// Guesses whether a volume that was not read as labels holds labels: its values are integers, and
/// neighbouring voxels are mostly equal or else unrelated. Good enough for a hint to a person.
[[nodiscard]] bool looks_like_labels(const Volume& volume);

/// The ids in a volume of labels.
[[nodiscard]] std::set<std::int64_t> label_ids(const Volume& volume);

/// How to read a headerless file.
struct RawLayout {
  std::array<std::uint32_t, 3> dims{};
  ScalarType type = ScalarType::u8;
  glm::dvec3 spacing{1.0};
  bool big_endian = false;
  std::uint64_t offset = 0;  ///< bytes before the first voxel

  bool operator==(const RawLayout&) const = default;
};

/// Half-open ranges of voxels along x, y and z.
struct VoxelBox {
  std::array<std::uint32_t, 3> begin{};
  std::array<std::uint32_t, 3> end{};  ///< 0: the end of the volume

  bool operator==(const VoxelBox&) const = default;
};

struct VolumeOptions {
  std::optional<RawLayout> raw{};  ///< the layout of a raw file, which does not state it itself
  bool labels = false;             ///< read values as ids
  /// Which component of each voxel to read (of RGB, vectors, channels), from 0.
  std::optional<std::uint32_t> component{};
  std::optional<std::uint32_t> time{};  ///< which of several volumes in a file to read, from 0
  /// Which of several arrays in a file to read, by its name (VTI), or which image of an OME-TIFF,
  /// by its name, ID or number.
  std::optional<std::string> array{};
  std::optional<VoxelBox> crop{};  ///< keep only these voxels; their position does not change
  /// Distances between voxels along x, y and z, for files that state none or wrong ones.
  std::optional<glm::dvec3> spacing{};
  /// Which DICOM series of a folder to read: its number or UID, or an id of list_series().
  std::optional<std::string> series{};
  /// Resample unevenly spaced DICOM slices to the smallest distance of two: linearly, or nearest
  /// for labels.
  bool resample = false;

  bool operator==(const VolumeOptions&) const = default;
};

/// The formats of files that read_volume() reads, but DICOM and raw data: "NRRD, NIfTI, ...".
[[nodiscard]] std::string volume_format_names();

/// Reads NIfTI-1/2 (.nii, .hdr with .img), Analyze 7.5 (.hdr with .img), FreeSurfer's .mgh and
/// .mgz, NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), DICOM, TIFF stacks (OME-TIFF and ImageJ's
/// among them), VTK images (.vti, .pvti, and .vtk with structured points), MRC/CCP4 (.mrc, .map),
/// arrays of NumPy
/// (.npy, .npz), a folder of PNGs, JPEGs or TIFFs, or raw data. A pair is named by either of its
/// files. The format is recognised by content, not by name. Any file may be packed by gzip, bzip2,
/// xz or zstd; some formats are then unpacked to a temporary file that has no name. Input is
/// untrusted: memory for voxels is used only once the file is known to be long enough, or as data
/// is decoded.
///
/// A known format that is not read is refused by name, with a way to convert it.
///
/// DICOM is a folder, from which `series` chooses if it has several, or one file. A multi-frame
/// file is the whole volume; any other file stands for its series: all files of its folder with the
/// same SeriesInstanceUID. Other files are ignored; those that are damaged are named in `notes`.
/// Slices at the same places are time points (echoes, b-values, phases), ordered by what their
/// files say of time. A segmentation is a volume of labels (a voxel of several segments belongs to
/// the largest fraction, then to the highest number), and the planes that it leaves out are empty.
/// Pixels may be plain, deflated, JPEG, JPEG-LS, JPEG 2000 or RLE. Compressed ones are decoded in a
/// child process, so call this before starting threads.
///
/// Position:
///  - NIfTI, in mm: the sform if its code is above 0, with shear; else the qform. With neither, the
///    grid is LAS and centred at the origin, as in nibabel and SPM.
///  - NRRD: spaces RAS and LAS are converted to LPS, others are used as they are. Without a space,
///    the spacings (default 1) and axis mins.
///  - DICOM: slices are ordered by their position along the normal, never by name. Without
///    positions, by SliceLocation, or by InstanceNumber at a stated spacing.
///  - TIFF: spacing in micrometres if OME's or ImageJ's metadata state it, else 1.
///  - MRC: ångströms.
///  - MGH: its directions and centre. Analyze: LAS, with SPM's origin if it has one, else centred.
///  - NumPy: the last three axes of an array are z, y and x; time may stand before them, colour
///    after. Spacing 1.
///  - A folder of pictures is stacked in the order of names, numbers by value.
///  - Files that only state spacings start at the origin.
///  - `spacing` replaces what the file states, right or wrong; directions and origin remain.
///
/// If voxels have several components, or the file has several volumes, `component` and `time`
/// choose one. Pictures whose channels are equal are read as grey; opacity is no channel of theirs.
///
/// Values. A scale that holds for the whole file is returned as slope and intercept. A DICOM series
/// whose scale differs from slice to slice (PET) becomes f32 with the scales applied. MONOCHROME1,
/// which displays the least value as white, is not inverted.
///
/// Errors:
///  - not_found: it, or its detached data file, does not exist
///  - io: unreadable, no permission
///  - bad_file: not what it claims, truncated, absurd dims, spacing or axes, a slice missing
///  - unsupported: several components, time points or DICOM series and none chosen, one slice, a
///    format or an encoding we do not read; the message names the choice
///  - usage: a headerless file without a layout; a layout, choice or crop that does not fit the
///    file; labels that are not integers
///  - out_of_memory: there is too little to read it
///
/// If a member of VolumeOptions would settle an error, Error::choice names it.
[[nodiscard]] Result<Volume> read_volume(const std::string& path,
                                         const VolumeOptions& options = {});

/// A volume, or several time points of it, among the DICOM files of a folder.
struct VolumeSeries {
  std::string id;  ///< its number if no other series has it, else the UID; ":2" for a second part
  std::string uid, number, description, modality;
  std::uint32_t slices = 0;
  std::array<std::uint32_t, 3> dims{};
  ScalarType type = ScalarType::u8;
  std::uint32_t components = 1, times = 1;
  std::string problem{};

  void describe(auto& member) const {
    member("id", id, "what the option `series` takes");
    member("uid", uid, "SeriesInstanceUID");
    member("number", number, "SeriesNumber; may be empty");
    member("description", description, "SeriesDescription; may be empty");
    member("modality", modality, "CT, MR, …; may be empty");
    member("slices", slices, "of all time points", R"("minimum": 1)");
    member("dims", dims, "voxels along x, y, z; 0 is unknown");
    member("type", name(type), "of a component");
    member("components", components, "numbers of a voxel", R"("minimum": 1)");
    member("times", times, "time points", R"("minimum": 1)");
    member("problem", problem.empty() ? nullptr : &problem,
           "why it is no volume; absent: nothing is known against it");
  }
};

struct SeriesList {
  std::vector<VolumeSeries> series{};  ///< ordered by number
  std::vector<std::string> notes{};    ///< files that cannot be read
};

/// The DICOM series of a folder or, if it has none, of the folders below it. Reads headers only.
/// bad_file: there are none. io: the folder cannot be read.
[[nodiscard]] Result<SeriesList> list_series(const std::string& folder);

}  // namespace slf
