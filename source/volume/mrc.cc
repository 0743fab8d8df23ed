// MRC2014 and CCP4 maps (.mrc, .map), https://www.ccpem.ac.uk/mrc_format/mrc2014.php.
//
// World coordinates are the file's, in ångströms; they have no anatomical directions.
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include "base/try.h"
#include "source/volume/fields.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

constexpr std::size_t kHeader = 1024;
constexpr std::int32_t kHalfFloats = 12;
constexpr std::int32_t kFourBits = 101;

/// The 4-byte words of the header, counted from 1 as the specification does.
struct Words : Fields {
  [[nodiscard]] std::int32_t integer(std::size_t word) const {
    return get<std::int32_t>(4 * (word - 1));
  }
  [[nodiscard]] double real(std::size_t word) const { return get<float>(4 * (word - 1)); }
};

// The machine stamp is often wrong. Tests instead in which order words 17 to 19 permute 1, 2, 3.
std::optional<bool> byte_order(std::string_view head) {
  for (const bool big : {false, true}) {
    const Words words{{head, big}};
    int seen = 0;
    for (const std::size_t word : {17, 18, 19}) {
      const auto axis = words.integer(word);
      if (axis >= 1 && axis <= 3) seen |= 1 << axis;
    }
    const bool unset = words.integer(17) == 0 && words.integer(18) == 0 && words.integer(19) == 0;
    if ((seen == 0b1110 || unset) && words.integer(4) >= 0 && words.integer(4) < 1024 &&
        words.integer(1) > 0 && words.integer(2) > 0 && words.integer(3) > 0)
      return big;
  }
  return std::nullopt;
}

Result<ScalarType> scalar_type(const std::string& path, const Words& words) {
  switch (const auto mode = words.integer(4)) {
    case 0: {
      // IMOD's stamp, with a flag for signed bytes; without it bytes are signed since 2014.
      constexpr std::int32_t kImod = 1146047817;
      const bool is_unsigned = words.integer(39) == kImod && (words.integer(40) & 1) == 0;
      return is_unsigned ? ScalarType::u8 : ScalarType::i8;
    }
    case 1:
      return ScalarType::i16;
    case 2:
      return ScalarType::f32;
    case 6:
    case kHalfFloats:
      return ScalarType::u16;  // half floats: as they are stored
    case kFourBits:
      return ScalarType::u8;
    case 3:
    case 4:
      return unsupported(
          path, "mode ", mode, " (complex numbers), expected 0, ",
          "1, 2, 6, 12 or 101: it is a transform; convert it to a map in real space");
    default:
      return bad_file(path, "mode is ", mode, ", expected 0, 1, 2, 6, 12 or 101");
  }
}

/// Computes the axes from the unit cell, whose edge a is along x and edge b in the xy plane.
Result<void> set_position(const Words& words, const std::array<int, 3>& axis_of,
                          const VolumeOptions& options, Volume& volume) {
  glm::dvec3 step, angle;
  bool scaled = true;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto intervals = words.integer(8 + i);
    const double length = words.real(11 + i);
    scaled = scaled && intervals > 0 && length > 0 && std::isfinite(length);
    step[static_cast<int>(i)] = length / intervals;
    const double degrees = words.real(14 + i);
    angle[static_cast<int>(i)] =
        (degrees > 0 && degrees < 180 ? degrees : 90) * std::numbers::pi / 180;
  }
  if (!scaled) {
    step = glm::dvec3(1);
    if (!options.spacing)
      volume.notes.emplace_back("it states no size of its cell: voxels are taken as 1x1x1");
  }
  for (std::size_t i = 0; i < 3; ++i) {
    double& along = step[static_cast<int>(axis_of[i])];
    along = SLF_TRY(spacing_or(options, i, along, volume.source, "its cell's spacing"));
  }
  const auto cosine = [&](int i) {
    return std::abs(angle[i] - std::numbers::pi / 2) < 1e-6 ? 0.0 : std::cos(angle[i]);
  };
  const double sine = std::sin(angle[2]);
  const double y = (cosine(0) - cosine(1) * cosine(2)) / sine;
  const double zz = 1 - cosine(1) * cosine(1) - y * y;
  const glm::dmat3 cell({step[0], 0, 0}, glm::dvec3(cosine(2), sine, 0) * step[1],
                        glm::dvec3(cosine(1), y, std::sqrt(std::max(zz, 0.0))) * step[2]);
  for (int storage = 0; storage < 3; ++storage)
    volume.axes[storage] = cell[axis_of[static_cast<std::size_t>(storage)]];
  glm::dvec3 start;
  for (int i = 0; i < 3; ++i) {
    const auto word = static_cast<std::size_t>(i);
    volume.origin[i] = words.real(50 + word);
    start[i] = words.integer(5 + word);
  }
  if (volume.origin == glm::dvec3(0)) volume.origin = volume.axes * start;
  volume.placement = "its cell, in angstroms";
  if (scaled) volume.unit = "Å";
  return {};
}

/// Reads 4-bit voxels: two per byte, the first in the low half. Each row begins on a new byte.
Result<void> read_four_bits(const VoxelData& data, Volume& volume) {
  const auto width = volume.dims[0];
  const std::size_t row = (std::size_t{width} + 1) / 2;
  Volume packed;
  packed.source = volume.source;
  packed.type = ScalarType::u8;
  packed.dims = {static_cast<std::uint32_t>(row), volume.dims[1], volume.dims[2]};
  SLF_TRY(read_voxels(data, packed));
  volume.files = std::move(packed.files);
  std::ranges::move(packed.notes, std::back_inserter(volume.notes));
  volume.voxels.resize(voxel_bytes(volume));
  for (std::size_t k = 0; k < volume.voxels.size(); ++k) {
    const std::size_t x = k % width;
    const std::byte two = packed.voxels[k / width * row + x / 2];
    volume.voxels[k] = x % 2 == 0 ? two & std::byte{15} : two >> 4;
  }
  return {};
}

}  // namespace

bool looks_like_mrc(std::string_view head) {
  return head.size() >= kHeader && head.substr(208, 3) == "MAP" && byte_order(head).has_value();
}

Result<Volume> read_mrc(const std::string& path, std::string_view head,
                        const VolumeOptions& options) {
  const Words words{{head, byte_order(head).value_or(false)}};
  Volume volume{.source = path};
  volume.type = SLF_TRY(scalar_type(path, words));
  std::vector<std::uint64_t> sizes;
  for (const std::size_t word : {1, 2, 3})
    sizes.push_back(static_cast<std::uint64_t>(words.integer(word)));
  // Space group 401: a stack of volumes, of mz sections each.
  const auto sections = static_cast<std::uint64_t>(std::max(words.integer(10), 1));
  if (words.integer(23) >= 401 && sizes[2] % sections == 0 && sections > 1) {
    sizes.push_back(sizes[2] / sections);
    sizes[2] = sections;
  }
  auto data = SLF_TRY(choose_volume(sizes, 1, options, volume));
  std::array<int, 3> axis_of{0, 1, 2};
  if (words.integer(17) != 0)
    for (std::size_t i = 0; i < 3; ++i) axis_of[i] = words.integer(17 + i) - 1;
  SLF_TRY(set_position(words, axis_of, options, volume));

  const auto extended = words.integer(24);
  if (extended < 0)
    return bad_file(path, "its extended header has ", extended, " bytes, expected 0 or more");
  data.big_endian = words.big_endian;
  data.skip = kHeader + static_cast<std::uint64_t>(extended);
  data.packed = packing_of_file(path) != Packing::none;
  const bool four_bits = words.integer(4) == kFourBits;
  SLF_TRY(four_bits ? read_four_bits(data, volume) : read_voxels(data, volume));
  if (words.integer(4) == kHalfFloats) widen_half_floats(volume);
  return volume;
}

}  // namespace slf::volume_io
