#include "slf/volume.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <new>

#include "base/try.h"
#include "source/volume/formats.h"
#include "source/volume/io.h"
#include "source/volume/voxels.h"

namespace slf {

using namespace volume_io;

namespace {

/// Whether every value can be an id: an integer, up to the rounding of values, slope and intercept.
/// Values that were rounded become i32, without slope and intercept.
bool make_labels(Volume& volume) {
  const bool whole =
      std::trunc(volume.slope) == volume.slope && std::trunc(volume.intercept) == volume.intercept;
  bool exact = true;
  std::vector<std::byte> ids;
  const bool all = visit_voxels(volume, [&](auto voxels) {
    using T = typename decltype(voxels)::value_type;
    if (std::is_integral_v<T> && whole) return true;
    double largest = 0;
    const auto value_of = [&](T v) {
      return volume.slope * static_cast<double>(v) + volume.intercept;
    };
    const bool near = std::ranges::all_of(voxels, [&](T stored) {
      const double value = value_of(stored), id = std::round(value);
      exact = exact && value == id;
      largest = std::max(largest, std::abs(id));
      const double terms = std::abs(value - volume.intercept) + std::abs(volume.intercept);
      return std::abs(value - id) <= std::min(1e-6 * terms, 0.05);
    });
    if (!near || exact || largest > std::numeric_limits<std::int32_t>::max()) return near && exact;
    for (const T stored : voxels) {
      const auto id = static_cast<std::int32_t>(std::round(value_of(stored)));
      const auto bytes = std::as_bytes(std::span(&id, 1));
      ids.insert(ids.end(), bytes.begin(), bytes.end());
    }
    return true;
  });
  if (ids.empty()) return all;
  volume.voxels = std::move(ids);
  volume.type = ScalarType::i32;
  volume.slope = 1, volume.intercept = 0;
  return true;
}

constexpr std::size_t kMinHeaderBytes = std::size_t{1} << 16;
constexpr std::size_t kMaxHeaderBytes = kMinHeaderBytes << 4;

/// Replaces the path of an unpacked file by that of the packed one.
void rename_source(std::string& text, const std::string& from, const std::string& to) {
  for (auto at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
}

Result<Volume> read_packed(const VolumeFormat& format, const std::string& path,
                           std::string_view head, const VolumeOptions& options) {
  const auto unpacked = SLF_TRY(UnpackedFile::make(path));
  auto volume = format.read(unpacked.path(), head, options);
  if (!volume) {
    rename_source(volume.error().message, unpacked.path(), path);
    return volume;
  }
  for (std::string* text : {&volume->source, &volume->placement})
    rename_source(*text, unpacked.path(), path);
  for (auto* texts : {&volume->files, &volume->notes})
    for (std::string& text : *texts) rename_source(text, unpacked.path(), path);
  return volume;
}

Result<Volume> read_any(const std::string& path, const VolumeOptions& options) {
  std::error_code code;
  if (std::filesystem::is_directory(path, code)) {
    if (options.raw) return misuse(path, "a raw layout was given, but this is a folder");
    return read_folder(path, options);
  }
  if (options.raw) {
    SLF_TRY(refuse_series(path, options));
    return read_raw(path, *options.raw, options);
  }
  if (lower_case(without_packing(path)).ends_with(".img")) {
    const auto header = partner_of(path, ".hdr");
    if (const auto head = read_head(header, kMinHeaderBytes); head && is_header_of_pair(*head)) {
      auto volume = read_nifti(header, *head, options);
      if (volume) volume->files.push_back(header);
      return volume;
    }
  }
  const auto size = SLF_TRY(file_size(path));
  if (size == 0) return bad_file(path, "the file is empty; copy or download it again");
  const auto head = SLF_TRY(
      read_head(path, std::clamp<std::uint64_t>(size * 4, kMinHeaderBytes, kMaxHeaderBytes)));
  const VolumeFormat* format = format_of(head);
  if (!format || format->read != read_dicom_file) SLF_TRY(refuse_series(path, options));
  if (options.array && !(format && format->names_arrays))
    return misuse(path, "array ", in_quotes(*options.array),
                  " was chosen, but files of this format name none");
  if (!format) return refuse_file(path, head);
  const bool as_it_is =
      format->unpacks_itself || (format->names_files && format->names_files(head));
  if (packing_of_file(path) != Packing::none && !as_it_is)
    return read_packed(*format, path, head, options);
  return format->read(path, head, options);
}

}  // namespace

namespace volume_io {

Result<Volume> read_raw(const std::string& path, const RawLayout& layout,
                        const VolumeOptions& options) {
  Volume volume{.type = layout.type, .source = path};
  const auto dims = check_dims(path, {layout.dims.begin(), layout.dims.end()});
  if (!dims) return fail(ErrorCode::usage, dims.error().message);
  volume.dims = *dims;
  for (int i = 0; i < 3; ++i) {
    if (!(layout.spacing[i] > 0) || !std::isfinite(layout.spacing[i]))
      return misuse(path, "spacing along axis ", i, " is ", layout.spacing[i],
                    ", expected a positive number");
    volume.axes[i][i] = layout.spacing[i];
  }
  if (const auto ok = check_axes(volume); !ok) return fail(ErrorCode::usage, ok.error().message);
  const auto size = SLF_TRY(file_size(path));
  const std::uint64_t needed = voxel_bytes(volume);
  if (!is_named_and_packed(path) && (layout.offset > size || needed > size - layout.offset))
    return fail_without("raw", ErrorCode::usage, path, ": dimensions ", joined(layout.dims, "x"),
                        " of type ", name(layout.type), " at offset ", layout.offset, " need ",
                        needed, " bytes after the offset, but the file has ", size,
                        " bytes in all: choose another layout");
  VoxelData data{.files = {path}, .offset = layout.offset, .big_endian = layout.big_endian};
  // The layout does not state the number of time points: the length of the file is the limit. If
  // one is chosen, whole volumes after it are no sign of a wrong layout.
  data.index = options.time.value_or(0);
  data.volumes = data.index + 1;
  if (options.time && !is_named_and_packed(path) && (size - layout.offset) % needed == 0)
    data.volumes = std::max(data.volumes, (size - layout.offset) / needed);
  SLF_TRY(read_voxels(data, volume));
  return volume;
}

}  // namespace volume_io

namespace {

Result<void> check_spacing(const std::string& path, const VolumeOptions& options) {
  for (int i = 0; options.spacing && i < 3; ++i)
    if (const double spacing = (*options.spacing)[i]; !(spacing > 1e-30) || !(spacing < 1e30))
      return misuse(path, "spacing ", i, " is ", spacing, ", expected a positive number");
  return {};
}

Result<void> crop(const VoxelBox& box, Volume& volume) {
  const auto from = box.begin;
  auto to = box.end;
  for (std::size_t i = 0; i < 3; ++i) {
    if (to[i] == 0) to[i] = volume.dims[i];
    if (to[i] > volume.dims[i] || from[i] >= to[i] || to[i] - from[i] < 2)
      return misuse(volume.source, "a crop from ", from[i], " to ", to[i], " along ", "xyz"[i],
                    ", expected at least 2 voxels within 0 to ", volume.dims[i]);
  }
  const std::size_t voxel = bytes_per_voxel(volume.type);
  const std::size_t row = (to[0] - from[0]) * voxel;
  std::vector<std::byte> kept;
  kept.reserve(row * (to[1] - from[1]) * (to[2] - from[2]));
  for (std::size_t z = from[2]; z < to[2]; ++z)
    for (std::size_t y = from[1]; y < to[1]; ++y) {
      const auto first = volume.voxels.begin() +
                         static_cast<std::ptrdiff_t>(
                             ((z * volume.dims[1] + y) * volume.dims[0] + from[0]) * voxel);
      kept.insert(kept.end(), first, first + static_cast<std::ptrdiff_t>(row));
    }
  volume.voxels = std::move(kept);
  volume.origin += volume.axes * glm::dvec3(from[0], from[1], from[2]);
  for (std::size_t i = 0; i < 3; ++i) volume.dims[i] = to[i] - from[i];
  return {};
}

}  // namespace

Result<Volume> read_volume(const std::string& path, const VolumeOptions& options) try {
  try {
    SLF_TRY(check_spacing(path, options));
    auto volume = read_any(path, options);
    if (!volume) return volume;
    if (std::ranges::find(volume->files, path) == volume->files.end())
      volume->files.push_back(path);
    if (!has_finite_value(*volume))
      volume->notes.emplace_back("all values are NaN or infinite: there is nothing to draw");
    SLF_TRY(place(options, *volume));
    if (options.crop) SLF_TRY(crop(*options.crop, *volume));
    if (!options.labels) return volume;
    if (!make_labels(*volume))
      return misuse(path, "read as labels, but its values (", name(volume->type), ", slope ",
                    volume->slope, ") are not all integers: it holds amounts, not ids");
    volume->labels = true;
    return volume;
  } catch (const std::bad_alloc&) {
    return fail(ErrorCode::out_of_memory, path, ": not enough memory to read it");
  } catch (const std::exception& error) {
    return fail(ErrorCode::failed, path, ": ", error.what());
  }
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
