// NIfTI-1 and NIfTI-2, one file (.nii, .nii.gz) or a .hdr with its .img; and Analyze 7.5, from
// which NIfTI's header was made, with SPM's scale and origin.
//
// The format is a header with fixed offsets (nifti1.h, nifti2.h) and the arithmetic of two
// transforms, below. doc/decisions/volumes.md says why we read it ourselves.
#include <algorithm>
#include <cmath>
#include <iomanip>
#include <numbers>

#include "base/bytes.h"
#include "base/try.h"
#include "source/volume/fields.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

constexpr std::size_t kHeader1 = 348;
constexpr std::size_t kHeader2 = 540;

struct NiftiHeader {
  bool big_endian = false;
  bool single_file = true;
  std::array<std::int64_t, 8> dim{};
  int datatype = 0;
  std::array<double, 8> pixdim{};
  double vox_offset = 0;
  double slope = 0, intercept = 0;
  int qform_code = 0, sform_code = 0;
  glm::dvec3 quaternion{0.0}, qoffset{0.0};
  std::array<glm::dvec4, 3> srow{};
  int units = 0;
  bool analyze = false;
  std::optional<glm::dvec3> spm_origin;  ///< the world's origin, in voxels from 1
};

/// The byte order in which the header's first field is `size`.
std::optional<bool> big_endian_of(std::string_view head, std::uint32_t size) {
  if (head.size() < size) return std::nullopt;
  const auto* from = reinterpret_cast<const std::byte*>(head.data());
  if (load_le<std::uint32_t>(from) == size) return false;
  if (load_be<std::uint32_t>(from) == size) return true;
  return std::nullopt;
}

// Reads the header of either version: Real is its floating type, Extent that of its dims.
template <class Real, class Extent, class Code>
void fill(const Fields& from, std::size_t dim, std::size_t pixdim, std::size_t scale,
          std::size_t codes, NiftiHeader& to) {
  for (std::size_t i = 0; i < 8; ++i) {
    to.dim[i] = from.get<Extent>(dim + i * sizeof(Extent));
    to.pixdim[i] = from.get<Real>(pixdim + i * sizeof(Real));
  }
  to.slope = from.get<Real>(scale);
  to.intercept = from.get<Real>(scale + sizeof(Real));
  to.qform_code = from.get<Code>(codes);
  to.sform_code = from.get<Code>(codes + sizeof(Code));
  std::size_t at = codes + 2 * sizeof(Code);
  const auto next = [&] { return double{from.get<Real>(std::exchange(at, at + sizeof(Real)))}; };
  for (int i = 0; i < 3; ++i) to.quaternion[i] = next();
  for (int i = 0; i < 3; ++i) to.qoffset[i] = next();
  for (auto& row : to.srow)
    for (int i = 0; i < 4; ++i) row[i] = next();
}

bool has_magic(std::string_view head) {
  if (big_endian_of(head, kHeader1)) {
    const auto magic = head.substr(344, 4);
    return magic == std::string_view("n+1\0", 4) || magic == std::string_view("ni1\0", 4);
  }
  if (!big_endian_of(head, kHeader2)) return false;
  const auto magic = head.substr(4, 4);
  return magic == std::string_view("n+2\0", 4) || magic == std::string_view("ni2\0", 4);
}

/// Analyze has no magic: its header is a short file, of this size and with counts that make sense.
bool looks_like_analyze(std::string_view head) {
  constexpr std::size_t kLongestHeader = 1024;
  const auto big = big_endian_of(head, kHeader1);
  if (!big || head.size() > kLongestHeader || has_magic(head)) return false;
  const auto rank = Fields{head, *big}.get<std::int16_t>(40);
  return rank >= 1 && rank <= 7;
}

/// Replaces what Analyze has in the place of NIfTI's fields for scale and position.
void take_as_analyze(const Fields& from, NiftiHeader& header) {
  header.analyze = true;
  header.single_file = false;
  header.intercept = 0;
  header.qform_code = header.sform_code = header.units = 0;
  for (std::size_t i = 1; i <= 3; ++i) header.pixdim[i] = std::abs(header.pixdim[i]);
  glm::dvec3 origin;
  bool inside = false;
  for (std::size_t i = 0; i < 3; ++i) {
    origin[static_cast<int>(i)] = from.get<std::int16_t>(253 + 2 * i);
    inside = inside || origin[static_cast<int>(i)] != 0;
  }
  // As nibabel does: what lies far outside is something else.
  for (std::size_t i = 0; i < 3; ++i) {
    const double at = origin[static_cast<int>(i)], extent = double(header.dim[i + 1]);
    inside = inside && at > -extent && at < 2 * extent;
  }
  if (inside) header.spm_origin = origin;
}

NiftiHeader parse(std::string_view head) {
  NiftiHeader header;
  if (const auto big = big_endian_of(head, kHeader1)) {
    const Fields from{head, *big};
    header.big_endian = *big;
    header.single_file = head[345] == '+';
    header.datatype = from.get<std::int16_t>(70);
    header.vox_offset = from.get<float>(108);
    header.units = from.get<std::uint8_t>(123);
    fill<float, std::int16_t, std::int16_t>(from, 40, 76, 112, 252, header);
    if (!has_magic(head)) take_as_analyze(from, header);
  } else {
    header.big_endian = big_endian_of(head, kHeader2).value_or(false);
    const Fields from{head, header.big_endian};
    header.single_file = head[5] == '+';
    header.datatype = from.get<std::int16_t>(12);
    header.vox_offset = static_cast<double>(from.get<std::int64_t>(168));
    header.units = from.get<std::int32_t>(500);
    fill<double, std::int64_t, std::int32_t>(from, 16, 104, 176, 344, header);
  }
  return header;
}

struct Datatype {
  int code;
  ScalarType type;
  std::uint32_t components = 1;  ///< of a voxel: colours and complex numbers have several
};
constexpr Datatype kDatatypes[] = {{2, ScalarType::u8},
                                   {4, ScalarType::i16},
                                   {8, ScalarType::i32},
                                   {16, ScalarType::f32},
                                   {32, ScalarType::f32, 2},
                                   {64, ScalarType::f64},
                                   {128, ScalarType::u8, 3},
                                   {256, ScalarType::i8},
                                   {512, ScalarType::u16},
                                   {768, ScalarType::u32},
                                   {1024, ScalarType::i64},
                                   {1280, ScalarType::u64},
                                   {1792, ScalarType::f64, 2},
                                   {2304, ScalarType::u8, 4},
                                   // SPM's additions to Analyze.
                                   {130, ScalarType::i8},
                                   {132, ScalarType::u16},
                                   {136, ScalarType::u32}};

Result<Datatype> datatype_of(const std::string& path, int code) {
  for (const Datatype& known : kDatatypes)
    if (known.code == code) return known;
  if (code == 1 || code == 1536 || code == 2048)
    return unsupported(path, "datatype ", code,
                       " (bits or 128 bit floats): convert to 8, 16, 32 or 64 bits");
  return bad_file(path, "unknown datatype code ", code);
}

struct Transform {
  glm::dmat3 axes{1.0};
  glm::dvec3 origin{0.0};
};

Transform sform_of(const NiftiHeader& header) {
  Transform t;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column)
      t.axes[column][row] = header.srow[static_cast<std::size_t>(row)][column];
    t.origin[row] = header.srow[static_cast<std::size_t>(row)][3];
  }
  return t;
}

// nifti1.h, method 2: the quaternion (a,b,c,d), where a follows from the others. pixdim[0] is the
// handedness.
Transform qform_of(const NiftiHeader& header) {
  double b = header.quaternion.x, c = header.quaternion.y, d = header.quaternion.z;
  double a = 1 - (b * b + c * c + d * d);
  if (a < 1e-7) {  // a turn by half a circle, rounded
    const double norm = 1 / std::sqrt(b * b + c * c + d * d);
    b *= norm, c *= norm, d *= norm, a = 0;
  } else {
    a = std::sqrt(a);
  }
  Transform t;
  t.axes[0] = {a * a + b * b - c * c - d * d, 2 * (b * c + a * d), 2 * (b * d - a * c)};
  t.axes[1] = {2 * (b * c - a * d), a * a + c * c - b * b - d * d, 2 * (c * d + a * b)};
  t.axes[2] = {2 * (b * d + a * c), 2 * (c * d - a * b), a * a + d * d - b * b - c * c};
  t.axes[2] *= header.pixdim[0] < 0 ? -1 : 1;
  for (int i = 0; i < 3; ++i) t.axes[i] *= header.pixdim[static_cast<std::size_t>(i) + 1];
  t.origin = header.qoffset;
  return t;
}

bool is_usable(const Transform& t) {
  return check_axes(Volume{.axes = t.axes, .origin = t.origin}).has_value();
}

/// The greatest distance between the positions that two transforms give a voxel. It is at a corner.
double greatest_distance(const Transform& a, const Transform& b, const Volume& volume) {
  double greatest = 0;
  for (int corner = 0; corner < 8; ++corner) {
    glm::dvec3 index;
    for (int i = 0; i < 3; ++i)
      index[i] = (corner >> i & 1) * double(volume.dims[static_cast<std::size_t>(i)] - 1);
    const glm::dvec3 d = (a.axes - b.axes) * index + (a.origin - b.origin);
    greatest = std::max(greatest, glm::length(d));
  }
  return greatest;
}

/// The angle between two axes that differs most from 90 degrees, in degrees.
double most_oblique_angle(const glm::dmat3& axes) {
  double angle = 90;
  for (int i = 0; i < 3; ++i) {
    const glm::dvec3 u = glm::normalize(axes[i]), v = glm::normalize(axes[(i + 1) % 3]);
    const double between =
        std::acos(std::clamp(glm::dot(u, v), -1.0, 1.0)) * 180 / std::numbers::pi;
    if (std::abs(between - 90) > std::abs(angle - 90)) angle = between;
  }
  return angle;
}

/// A number for people, in few digits.
std::string brief(double value) { return concat(std::setprecision(3), value); }

// Chooses as nibabel, FSL and NiiVue do: the sform if its code is set, else the qform. With
// neither, nibabel and SPM treat the grid as LAS with the world's origin at its centre. ITK prefers
// the qform in some cases, and refuses shear, which our ray-caster supports.
Result<void> set_position(NiftiHeader header, const VolumeOptions& options, Volume& volume) {
  const Transform sform = sform_of(header), qform = qform_of(header);
  constexpr int kMetre = 1, kMicron = 3;
  const int unit = header.units & 7;
  const double to_mm = unit == kMetre ? 1e3 : unit == kMicron ? 1e-3 : 1;
  if (unit >= kMetre && unit <= kMicron) volume.unit = "mm";
  const bool has_sform = header.sform_code > 0, has_qform = header.qform_code > 0;
  // A quaternion or an offset states a place even if its code is not set.
  const bool states_qform =
      has_qform || header.quaternion != glm::dvec3(0) || header.qoffset != glm::dvec3(0);
  const bool damaged_sform = has_sform && states_qform && !is_usable(sform);
  const auto code = [](int value) { return " (code " + std::to_string(value) + ")"; };
  Transform t;
  if (has_sform && !damaged_sform) {
    t = sform;
    volume.placement = "sform" + code(header.sform_code);
    if (const double angle = is_usable(t) ? most_oblique_angle(t.axes) : 90;
        std::abs(angle - 90) > 0.1)
      volume.notes.push_back("its sform is sheared: two of its axes meet at " + brief(angle) +
                             " degrees; it is drawn so");
  } else {
    for (std::size_t i = 1; i <= 3; ++i) {
      const double millimetres =
          SLF_TRY(spacing_or(options, i - 1, header.pixdim[i] * to_mm, volume.source,
                             "spacing (pixdim[" + std::to_string(i) + "])"));
      header.pixdim[i] = millimetres / to_mm;
    }
    if (has_qform || damaged_sform) {
      t = qform_of(header);
      volume.placement = "qform" + code(header.qform_code);
      if (damaged_sform)
        volume.notes.push_back("its sform" + code(header.sform_code) +
                               " is singular or not finite: placed by its qform" +
                               code(header.qform_code));
    } else {
      for (int i = 0; i < 3; ++i) {
        const auto axis = static_cast<std::size_t>(i);
        t.axes[i][i] = header.pixdim[axis + 1] * (i == 0 ? -1 : 1);
        t.origin[i] = t.axes[i][i] * (header.spm_origin ? 1 - (*header.spm_origin)[i]
                                                        : -0.5 * (double(volume.dims[axis]) - 1));
      }
      volume.placement = header.spm_origin ? "pixdim and SPM's origin"
                         : header.analyze  ? "pixdim"
                                           : "pixdim (neither sform nor qform)";
      volume.notes.push_back(
          std::string(header.analyze
                          ? "Analyze names no orientation"
                          : "it names no orientation (sform_code and qform_code are 0)") +
          ": placed as nibabel and SPM do, LAS" + (header.spm_origin ? "" : " and centred") +
          "; left and right may be swapped");
    }
  }
  if (has_sform && has_qform && !damaged_sform && is_usable(sform) && is_usable(qform)) {
    const double apart = greatest_distance(sform, qform, volume);
    double min_length = HUGE_VAL;
    for (int i = 0; i < 3; ++i) min_length = std::min(min_length, glm::length(sform.axes[i]));
    if (apart > 0.1 * min_length)
      volume.notes.push_back("placed by its sform" + code(header.sform_code) + "; its qform" +
                             code(header.qform_code) + " differs by up to " + brief(apart) +
                             " units");
  }
  for (int i = 0; i < 3; ++i) t.axes[i] *= glm::dvec3(-1, -1, 1);  // from RAS to LPS
  t.origin *= glm::dvec3(-1, -1, 1);
  for (int i = 0; i < 3; ++i) volume.axes[i] = t.axes[i] * to_mm + 0.0;  // + 0.0: no -0
  volume.origin = t.origin * to_mm + 0.0;
  volume.patient_axes = has_sform || has_qform;
  return {};
}

}  // namespace

bool looks_like_nifti(std::string_view head) { return has_magic(head) || looks_like_analyze(head); }

bool is_header_of_pair(std::string_view head) {
  return looks_like_nifti(head) && !parse(head).single_file;
}

Result<Volume> read_nifti(const std::string& path, std::string_view head,
                          const VolumeOptions& options) {
  const NiftiHeader header = parse(head);
  Volume volume{.source = path};
  const std::int64_t rank = header.dim[0];
  if (rank < 1 || rank > 7)
    return bad_file(path, "dim[0] is ", rank, ", expected 1 to 7 dimensions");
  std::vector<std::uint64_t> sizes;
  for (std::size_t i = 1; i <= static_cast<std::size_t>(rank); ++i) {
    if (header.dim[i] < 1)
      return bad_file(path, "dim[", i, "] is ", header.dim[i], ", expected at least 1");
    sizes.push_back(static_cast<std::uint64_t>(header.dim[i]));
  }
  const Datatype datatype = SLF_TRY(datatype_of(path, header.datatype));
  volume.type = datatype.type;
  auto data = SLF_TRY(choose_volume(sizes, datatype.components, options, volume));
  SLF_TRY(set_position(header, options, volume));

  // A slope of 0 means that there is none.
  if (header.slope != 0 && std::isfinite(header.slope) && std::isfinite(header.intercept)) {
    volume.slope = header.slope;
    volume.intercept = header.intercept;
  }
  if (!(header.vox_offset >= 0) || !(header.vox_offset < 0x1p53))
    return bad_file(path, "vox_offset is ", header.vox_offset,
                    ", expected the byte where the voxels begin");
  data.big_endian = header.big_endian;
  data.skip = static_cast<std::uint64_t>(header.vox_offset);
  const std::uint64_t header_bytes = big_endian_of(head, kHeader1) ? kHeader1 : kHeader2;
  if (!header.single_file)
    data.files = {partner_of(path, ".img")};
  else if (data.skip < header_bytes)
    data.skip = header_bytes + 4;  // unset: after the header and its extension flag
  if (const auto size = file_size(data.files.front()); !size)
    return fail_in(size.error(), path, ": its voxels cannot be read: ");
  data.packed = packing_of_file(data.files.front()) != Packing::none;
  SLF_TRY(read_voxels(data, volume));
  return volume;
}

}  // namespace slf::volume_io
