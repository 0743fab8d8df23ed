// Volume: a 3D scalar image in world coordinates, and its readers.
//
// World coordinates are millimetres (or whatever unit the file is in) in the LPS convention of
// DICOM and ITK: +x to the patient's left, +y to the back, +z to the head. NIfTI files, which are
// RAS, have x and y negated, so the same scan gives the same world in every format and a left hand
// stays a left hand.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
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
/// char", and so for the others. usage: unknown; the message lists the short names.
[[nodiscard]] Result<ScalarType> parse_scalar_type(std::string_view text);

/// Voxels as stored in the file (8 and 16 bits stay so), x fastest, then y, then z.
struct Volume {
  std::array<std::uint32_t, 3> dims{};
  ScalarType type = ScalarType::u8;
  std::vector<std::byte> voxels;  ///< native endian, dims product × bytes_per_voxel(type)
  /// The value of a voxel is slope × stored + intercept (scl_slope, RescaleSlope).
  double slope = 1;
  double intercept = 0;
  /// World position of the centre of voxel (i,j,k) is origin + axes · (i,j,k): the columns of
  /// `axes` are the unit axis directions times the spacing. Never singular.
  glm::dmat3 axes{1.0};
  glm::dvec3 origin{0.0};
  /// Values are ids, not amounts: never interpolated.
  bool labels = false;
  std::string source;              ///< the path it was read from, for messages and provenance
  std::vector<std::string> files;  ///< all files it was read from, headers and data
  /// What placed it in the world where the format leaves a choice, as "sform (code 4)"; else empty.
  std::string placement;
  /// What the reader decided and a person may want to check, a line each.
  std::vector<std::string> notes;

  [[nodiscard]] glm::dvec3 spacing() const;
  [[nodiscard]] std::uint64_t voxel_count() const;
  /// Least and greatest finite value, after slope and intercept.
  [[nodiscard]] std::array<double, 2> value_range() const;
};

/// Whether a volume that was not read as labels may hold them: its values are integers, and
/// neighbouring voxels are mostly equal or else unrelated. A guess, for a hint to a person.
[[nodiscard]] bool looks_like_labels(const Volume& volume);

/// How to read a headerless file.
struct RawLayout {
  std::array<std::uint32_t, 3> dims{};
  ScalarType type = ScalarType::u8;
  glm::dvec3 spacing{1.0};
  bool big_endian = false;
  std::uint64_t offset = 0;  ///< bytes before the first voxel
};

/// Half-open ranges of voxels along x, y and z.
struct VoxelBox {
  std::array<std::uint32_t, 3> begin{};
  std::array<std::uint32_t, 3> end{};  ///< 0: the end of the volume
};

struct VolumeOptions {
  std::optional<RawLayout> raw{};  ///< set for raw files, which name no layout themselves
  bool labels = false;
  /// Which of several numbers a voxel has (RGB, vectors, channels), from 0.
  std::optional<std::uint32_t> component{};
  std::optional<std::uint32_t> time{};  ///< which of several volumes in a file, from 0
  std::optional<VoxelBox> crop{};       ///< keeps these voxels, where they are in the world
  /// Distances between voxels, for files that state none or wrong ones: along x, y, z.
  std::optional<glm::dvec3> spacing{};
};

/// Reads NIfTI-1/2 (.nii, .nii.gz), NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), DICOM, TIFF stacks
/// (OME-TIFF and ImageJ's among them), VTK ImageData (.vti), MRC/CCP4 (.mrc, .map), a folder of
/// PNGs or TIFFs, or raw. The format is found from the content, not from the name. Input is
/// untrusted: no memory is touched before the file was found large enough to fill it, or has been
/// decoded.
///
/// DICOM is a folder that holds one series (what is not DICOM in it is ignored), or one file: a
/// multi-frame file is the volume, any other stands for its series, which is all files of its
/// folder with its SeriesInstanceUID. Pixels may be plain, deflated, JPEG, JPEG-LS, JPEG 2000 or
/// RLE; compressed ones are decoded in a child process: call this before starting threads.
///
/// Position. NIfTI: the sform where its code is above 0, shear included; else the qform; with
/// neither, the grid centred and LAS, as nibabel and SPM take it; in mm. NRRD: spaces RAS and LAS
/// become LPS, others are taken as they are; without a space, the spacings (1 where there are none)
/// and axis mins. DICOM: slices in order of their position along the normal, never of their names.
/// Files that only state spacings start at the origin. TIFF: micrometres where OME's or ImageJ's
/// metadata say, else 1; MRC: ångströms. A folder of pictures is stacked in the order of their
/// names, numbers by value.
///
/// Where voxels have several numbers or the file has several volumes, `component` and `time`
/// choose; colour pictures whose channels are equal are grey.
///
/// Values. A scale uniform over the file stays in slope and intercept. A DICOM series whose scale
/// differs from slice to slice (PET) cannot be said so: it becomes f32 with its scale applied.
/// MONOCHROME1, which shows the least value white, is read as the numbers it stores.
///
/// Errors:
///  - io: missing, unreadable, no permission, its detached data file missing
///  - bad_file: not what it claims, truncated, absurd dims, spacing or axes, a slice missing
///  - unsupported: several components or time points and none chosen, one slice, several DICOM
///    series, an encoding we do not read; the message names the choice
///  - usage: a headerless file without a layout; a layout, choice or crop that does not fit the
///    file; labels that are not integers
///  - failed: not enough memory
[[nodiscard]] Result<Volume> read_volume(const std::string& path,
                                         const VolumeOptions& options = {});

}  // namespace slf
