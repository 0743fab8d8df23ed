// Small volumes as the bytes of each format, written here from the formats' specifications and
// independently of the readers.
#pragma once

#include <filesystem>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "slf/volume.h"
#include "tests/temporary_folder.h"

namespace slf::samples {

class Folder {
 public:
  /// Writes a file in it and returns its path.
  std::string write(const std::string& name, const std::string& bytes) const;
  std::string path(const std::string& name = "") const;

 private:
  slf::testing::TemporaryFolder folder_;
};

inline constexpr std::array<ScalarType, 10> kAllTypes = {
    ScalarType::u8,  ScalarType::i8,  ScalarType::u16, ScalarType::i16, ScalarType::u32,
    ScalarType::i32, ScalarType::u64, ScalarType::i64, ScalarType::f32, ScalarType::f64};

/// The phantom: 5×4×3 voxels, each another value, and a marker, so that no flip or swap of axes
/// leaves it the same.
inline constexpr std::array<std::uint32_t, 3> kDims = {5, 4, 3};
inline constexpr std::array<std::uint32_t, 3> kMarker = {1, 2, 2};
inline constexpr double kMarkerValue = 101;
double phantom_value(std::uint32_t i, std::uint32_t j, std::uint32_t k);
/// Its voxels in a type and byte order, x fastest.
std::string phantom_bytes(ScalarType type, bool big_endian);
/// A stored voxel of a volume, after slope and intercept.
double value_at(const Volume& volume, std::uint32_t i, std::uint32_t j, std::uint32_t k);
glm::dvec3 world_of(const Volume& volume, std::uint32_t i, std::uint32_t j, std::uint32_t k);

/// An integer of 8 bytes if `wide`, else 4.
std::string integer_bytes(std::uint64_t value, bool wide, bool big_endian);

/// Reads a volume; a failure fails the test.
Volume expect_read(const std::string& path, const VolumeOptions& options = {});
/// Expects an error of this kind whose message contains `part`.
void expect_error(const std::string& path, ErrorCode code, const std::string& part,
                  const VolumeOptions& options = {});
/// Expects that a file cut anywhere is refused with an error that begins with its path.
void expect_cuts_refused(const Folder& folder, const std::string& file, const std::string& bytes);
/// Expects the phantom's voxels.
void expect_phantom(const Volume& volume, ScalarType type);

/// Where the phantom lies, in LPS: an oblique, left-handed grid with three different spacings.
glm::dmat3 phantom_axes();
glm::dvec3 phantom_origin();

struct Nifti {
  int version = 1;
  bool big_endian = false;
  ScalarType type = ScalarType::u8;
  int datatype = 0;  ///< 0: that of `type`
  std::vector<int> dim = {5, 4, 3};
  std::array<double, 8> pixdim = {1, 1, 1, 1, 0, 0, 0, 0};
  double slope = 0, intercept = 0;
  int qform = 0, sform = 0;
  std::array<double, 6> quaternion{};  ///< b, c, d, offset x, y, z
  std::array<double, 12> srow{};
  double vox_offset = -1;  ///< -1: right after the header
  int units = 2;
  std::string magic = "+";  ///< or "i"
};
/// Header and phantom.
std::string nifti(const Nifti& header);
/// srow of the phantom's place: RAS.
std::array<double, 12> phantom_srow();

std::string nrrd_type(ScalarType type);
std::string meta_type(ScalarType type);
/// "NRRD0004", the lines and a blank one; `data` after.
std::string nrrd(const std::string& lines, const std::string& data);
std::string phantom_nrrd(ScalarType type, bool big_endian, const std::string& space);
std::string phantom_meta(ScalarType type, bool big_endian, bool packed);
std::string gzip(const std::string& bytes);
std::string zlib(const std::string& bytes);

struct Dicom {
  std::string series = "1.2.3";
  std::string syntax = "1.2.840.10008.1.2.1";  ///< explicit VR little endian, or implicit
  std::uint32_t k = 0;                         ///< which slice of the phantom
  double slope = 1, intercept = 0;
  bool scaled = true;  ///< false: no rescale elements at all
  int samples = 1;
  std::string frames{};
  bool placed = true;
  std::array<double, 3> shift{};  ///< added to the position
};
std::string dicom(const Dicom& slice);

}  // namespace slf::samples
