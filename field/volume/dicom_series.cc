// Stacks the DICOM slices of a folder or a file to a volume, sorted by position.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <map>
#include <optional>
#include <span>

#include "field/volume/dicom.h"
#include "field/volume/io.h"
#include "field/volume/voxels.h"

namespace slf::volume_io {

namespace {

/// The slices of all files in a folder, or only those of one series.
Result<std::vector<DicomSlice>> read_headers(const std::string& folder,
                                             const std::optional<std::string>& series = {}) {
  std::vector<std::string> files;
  std::error_code code;
  for (auto it = std::filesystem::directory_iterator(folder, code);
       !code && it != std::filesystem::directory_iterator(); it.increment(code))
    if (it->is_regular_file(code)) files.push_back(it->path().string());
  if (code) return fail(ErrorCode::io, folder, ": ", code.message());
  std::sort(files.begin(), files.end());

  std::vector<DicomSlice> slices;
  for (const auto& file : files) {
    const auto head = read_head(file, 132);
    if (!head || !looks_like_dicom(*head)) continue;
    auto found = read_dicom_slices(file, series);
    if (!found) return found;
    std::move(found->begin(), found->end(), std::back_inserter(slices));
  }
  if (slices.empty())
    return fail(ErrorCode::bad_file, folder, ": no DICOM pictures among its ", files.size(),
                " files; give the folder that holds the slices themselves");
  return slices;
}

Result<void> check_one_series(const std::string& folder, const std::vector<DicomSlice>& slices) {
  std::map<std::string, std::size_t> count;
  for (const auto& slice : slices) ++count[slice.series];
  if (count.size() == 1) return {};
  std::string found;
  for (const auto& [series, n] : count)
    found += "\n  " + series + ": " + std::to_string(n) + " slices";
  return fail(ErrorCode::unsupported, folder, ": ", count.size(),
              " DICOM series, expected one: move the one you want to a folder of its own", found);
}

Result<void> check_alike(const std::vector<DicomSlice>& slices) {
  const auto& first = slices.front();
  for (const auto& slice : slices) {
    if (slice.frames > 1 && slice.path != first.path)
      return fail(ErrorCode::unsupported, slice.path, ": ", slice.frames,
                  " frames, one of several files: give the one file that holds the volume");
    const char* what =
        slice.width != first.width || slice.height != first.height ? "size"
        : slice.type != first.type                                 ? "pixel type"
        : glm::length(slice.row - first.row) > 1e-3 ||
                glm::length(slice.column - first.column) > 1e-3
            ? "orientation"
        : glm::length(slice.spacing - first.spacing) > 1e-3 * glm::length(first.spacing)
            ? "pixel spacing"
            : nullptr;
    if (what)
      return fail(ErrorCode::unsupported, slice.label(), ": its ", what, " is not that of ",
                  first.label(),
                  ": a volume needs slices that are alike; remove those that are not "
                  "(a localizer, perhaps)");
  }
  return {};
}

/// Sorts the slices along the normal and sets the axes. The third axis is the step from slice to
/// slice; with a tilted gantry it is oblique.
Result<void> set_position(std::vector<DicomSlice>& slices, Volume& volume) {
  const glm::dvec3 normal = glm::cross(slices[0].row, slices[0].column);
  const auto height = [&](const DicomSlice& s) { return glm::dot(normal, s.position); };
  std::stable_sort(slices.begin(), slices.end(),
                   [&](const DicomSlice& a, const DicomSlice& b) { return height(a) < height(b); });
  const auto steps = static_cast<double>(slices.size() - 1);
  const glm::dvec3 step = (slices.back().position - slices.front().position) / steps;
  const double gap = glm::dot(normal, step);
  for (std::size_t i = 1; i < slices.size(); ++i) {
    const double here = height(slices[i]) - height(slices[i - 1]);
    if (here < 1e-6)
      return fail(ErrorCode::unsupported, slices[i].label(), " and ", slices[i - 1].label(),
                  " lie at the same place: several time points or echoes; keep one of them");
    if (std::abs(here - gap) > 0.1 * gap)
      return fail(ErrorCode::bad_file, volume.source, ": slices are not evenly spaced: ", here,
                  " mm between ", slices[i - 1].label(), " and ", slices[i].label(), ", ", gap,
                  " mm on average: a slice is missing, or the series must be resampled");
  }
  volume.axes[0] = slices[0].row * slices[0].spacing.x;
  volume.axes[1] = slices[0].column * slices[0].spacing.y;
  volume.axes[2] = step;
  volume.origin = slices[0].position;
  return check_axes(volume);
}

/// Appends a slice's pixels: unchanged or, if the slices' scales differ, as f32 with the scale
/// applied.
void append(const DicomSlice& slice, std::span<const std::byte> pixels, Volume& volume) {
  if (volume.type == slice.type) {
    volume.voxels.insert(volume.voxels.end(), pixels.begin(), pixels.end());
    return;
  }
  Volume one;
  one.type = slice.type;
  one.voxels.assign(pixels.begin(), pixels.end());
  std::vector<float> scaled;
  visit_voxels(one, [&](auto stored) {
    for (const auto value : stored)
      scaled.push_back(
          static_cast<float>(slice.slope * static_cast<double>(value) + slice.intercept));
  });
  const auto bytes = std::as_bytes(std::span(scaled));
  volume.voxels.insert(volume.voxels.end(), bytes.begin(), bytes.end());
}

/// Fills the voxels. Allocates memory for all only after the first file has yielded its pixels.
Result<void> stack(const std::vector<DicomSlice>& slices, Volume& volume) {
  const bool one_file = slices.front().frames > 1;
  DicomPixelReader reader(one_file ? std::vector(1, slices.front()) : slices);
  std::vector<std::byte> pixels;
  for (const auto& slice : slices) {
    if (pixels.empty() || !one_file) {
      auto next = reader.next();
      if (!next) return tl::unexpected(next.error());
      pixels = std::move(*next);
    }
    if (volume.voxels.empty()) volume.voxels.reserve(voxel_bytes(volume));
    append(slice, std::span(pixels).subspan(slice.frame * slice.bytes(), slice.bytes()), volume);
  }
  return {};
}

Result<Volume> read_series(const std::string& path, std::vector<DicomSlice> slices) {
  Volume volume;
  volume.source = path;
  for (const DicomSlice& slice : slices) volume.files.push_back(slice.path);
  const auto& first = slices.front();
  volume.type = first.type;
  const std::array<std::uint64_t, 3> sizes{first.width, first.height, slices.size()};
  const auto dims = check_dims(path, sizes);
  if (!dims) return tl::unexpected(dims.error());
  volume.dims = *dims;
  if (auto r = check_alike(slices); !r) return tl::unexpected(r.error());
  if (auto r = set_position(slices, volume); !r) return tl::unexpected(r.error());

  const bool uniform = std::all_of(slices.begin(), slices.end(), [&](const DicomSlice& s) {
    return s.slope == slices.front().slope && s.intercept == slices.front().intercept;
  });
  if (uniform) {
    volume.slope = slices.front().slope;
    volume.intercept = slices.front().intercept;
  } else {
    volume.type = ScalarType::f32;
  }
  if (auto r = stack(slices, volume); !r) return tl::unexpected(r.error());
  return volume;
}

}  // namespace

Result<Volume> read_dicom_folder(const std::string& path) {
  auto slices = read_headers(path);
  if (!slices) return tl::unexpected(slices.error());
  if (auto r = check_one_series(path, *slices); !r) return tl::unexpected(r.error());
  return read_series(path, std::move(*slices));
}

Result<Volume> read_dicom_file(const std::string& path) {
  auto slices = read_dicom_slices(path);
  if (!slices) return tl::unexpected(slices.error());
  if (slices->empty())
    return fail(ErrorCode::bad_file, path,
                ": a DICOM file without a picture (a directory or a report); give the folder that "
                "holds the slices, or one of them");
  if (slices->front().frames == 1) {
    const auto folder = std::filesystem::path(path).parent_path();
    slices = read_headers(folder.empty() ? "." : folder.string(), slices->front().series);
    if (!slices) return tl::unexpected(slices.error());
    if (slices->size() == 1)
      return fail(ErrorCode::unsupported, path,
                  ": the single slice of its series in its folder; give a file that lies with the "
                  "others, or a multi-frame file");
  }
  return read_series(path, std::move(*slices));
}

}  // namespace slf::volume_io
