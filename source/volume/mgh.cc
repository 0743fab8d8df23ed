// FreeSurfer's volumes: .mgh, and .mgz, the same in gzip.
// https://surfer.nmr.mgh.harvard.edu/fswiki/FsTutorial/MghFormat
#include <algorithm>

#include "base/try.h"
#include "source/volume/fields.h"
#include "source/volume/io.h"

namespace slf::volume_io {

namespace {

constexpr std::size_t kMghHeader = 90, kVoxels = 284;

constexpr std::pair<std::int32_t, ScalarType> kTypes[] = {{0, ScalarType::u8},
                                                          {1, ScalarType::i32},
                                                          {3, ScalarType::f32},
                                                          {4, ScalarType::i16},
                                                          {10, ScalarType::u16}};

/// Sets the position from the directions of the axes and the centre of the volume, which are RAS.
Result<void> set_position(const Fields& header, const VolumeOptions& options, Volume& volume) {
  glm::dvec3 spacing(1.0), centre(0.0);
  glm::dmat3 directions(glm::dvec3(-1, 0, 0), glm::dvec3(0, 0, -1), glm::dvec3(0, 1, 0));
  if (header.get<std::int16_t>(28) > 0) {
    std::size_t at = 30;
    const auto next = [&] {
      const double value = header.get<float>(at);
      at += sizeof(float);
      return value;
    };
    for (int i = 0; i < 3; ++i) spacing[i] = next();
    for (int axis = 0; axis < 3; ++axis)
      for (int i = 0; i < 3; ++i) directions[axis][i] = next();
    for (int i = 0; i < 3; ++i) centre[i] = next();
    volume.unit = "mm";
    volume.patient_axes = true;
  } else {
    volume.notes.emplace_back(
        "it states no position: taken as FreeSurfer does, coronal slices of 1x1x1 mm");
  }
  const glm::dvec3 to_lps(-1, -1, 1);
  glm::dvec3 middle;
  for (int axis = 0; axis < 3; ++axis) {
    spacing[axis] =
        SLF_TRY(spacing_or(options, static_cast<std::size_t>(axis), spacing[axis], volume.source,
                           "spacing along axis " + std::to_string(axis)));
    volume.axes[axis] = to_lps * directions[axis] * spacing[axis] + 0.0;  // + 0.0: no -0
    middle[axis] = volume.dims[static_cast<std::size_t>(axis)] / 2.0;
  }
  volume.origin = to_lps * centre - volume.axes * middle + 0.0;
  return {};
}

}  // namespace

// There is no magic but the version, 1. The type and the counts must make sense, too.
bool looks_like_mgh(std::string_view head) {
  if (head.size() < kMghHeader) return false;
  const Fields header{head, true};
  const auto type = header.get<std::int32_t>(20);
  const auto placed = header.get<std::int16_t>(28);
  bool counted = true;
  for (const std::size_t at : {4, 8, 12, 16}) counted = counted && header.get<std::int32_t>(at) > 0;
  return header.get<std::int32_t>(0) == 1 && counted && type >= 0 && type <= 10 &&
         (placed == 0 || placed == 1);
}

Result<Volume> read_mgh(const std::string& path, std::string_view head,
                        const VolumeOptions& options) {
  const Fields header{head, true};
  Volume volume{.source = path};
  const auto code = header.get<std::int32_t>(20);
  const auto* type = std::ranges::find(kTypes, code, &std::pair<std::int32_t, ScalarType>::first);
  if (type == std::end(kTypes))
    return unsupported(path, "MGH voxels of type ", code,
                       ", expected 0, 1, 3, 4 or 10: convert it, `mri_convert IN OUT.nii.gz`");
  volume.type = type->second;
  std::vector<std::uint64_t> sizes;
  for (const std::size_t at : {4, 8, 12, 16})
    sizes.push_back(static_cast<std::uint64_t>(header.get<std::int32_t>(at)));
  auto data = SLF_TRY(choose_volume(sizes, 1, options, volume));
  SLF_TRY(set_position(header, options, volume));
  data.packed = packing_of_file(path) != Packing::none;
  data.skip = kVoxels;
  data.big_endian = true;
  data.volumes = 0;  // not all that follows: FreeSurfer's tags are behind the last
  SLF_TRY(read_voxels(data, volume));
  return volume;
}

}  // namespace slf::volume_io
