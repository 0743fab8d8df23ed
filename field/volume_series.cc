// A folder of DICOM slices, sorted in space and stacked.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <map>

#include "field/volume_dicom.h"
#include "field/volume_io.h"
#include "field/volume_voxels.h"

namespace slf::volume_io {

namespace {

Result<std::vector<DicomSlice>> read_headers(const std::string& folder) {
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
    auto slice = read_dicom_header(file);
    if (!slice) return tl::unexpected(slice.error());
    if (!slice->series.empty()) slices.push_back(std::move(*slice));
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
      return fail(ErrorCode::unsupported, slice.path, ": its ", what, " is not that of ",
                  first.path,
                  ": a volume needs slices that are alike; remove those that are not "
                  "(a localizer, perhaps)");
  }
  return {};
}

/// Sorts along the normal and sets the axes. The third is the way from slice to slice, which a
/// tilted gantry makes oblique.
Result<void> place(std::vector<DicomSlice>& slices, Volume& volume) {
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
      return fail(ErrorCode::unsupported, slices[i].path, " and ", slices[i - 1].path,
                  " lie at the same place: several time points or echoes; keep one of them");
    if (std::abs(here - gap) > 0.1 * gap)
      return fail(ErrorCode::bad_file, volume.source, ": slices are not evenly spaced: ", here,
                  " mm between ", slices[i - 1].path, " and ", slices[i].path, ", ", gap,
                  " mm on average: a slice is missing, or the series must be resampled");
  }
  volume.axes[0] = slices[0].row * slices[0].spacing.x;
  volume.axes[1] = slices[0].column * slices[0].spacing.y;
  volume.axes[2] = step;
  volume.origin = slices[0].position;
  return check_axes(volume);
}

/// Slices whose scales differ have no one slope: they become f32.
Result<void> stack_scaled(const std::vector<DicomSlice>& slices, Volume& volume) {
  const std::uint64_t in_slice = std::uint64_t{volume.dims[0]} * volume.dims[1];
  Volume one = volume;
  volume.type = ScalarType::f32;
  volume.voxels.resize(voxel_bytes(volume));
  auto* to = reinterpret_cast<float*>(volume.voxels.data());
  for (const auto& slice : slices) {
    auto pixels = read_dicom_pixels(slice);
    if (!pixels) return tl::unexpected(pixels.error());
    one.voxels = std::move(*pixels);
    visit_voxels(one, [&](auto stored) {
      for (std::size_t i = 0; i < in_slice; ++i)
        to[i] = static_cast<float>(slice.slope * static_cast<double>(stored[i]) + slice.intercept);
    });
    to += in_slice;
  }
  return {};
}

Result<void> stack(const std::vector<DicomSlice>& slices, Volume& volume) {
  volume.voxels.resize(voxel_bytes(volume));
  auto* to = volume.voxels.data();
  for (const auto& slice : slices) {
    const auto pixels = read_dicom_pixels(slice);
    if (!pixels) return tl::unexpected(pixels.error());
    std::memcpy(to, pixels->data(), pixels->size());
    to += pixels->size();
  }
  return {};
}

}  // namespace

Result<Volume> read_dicom_folder(const std::string& path) {
  auto slices = read_headers(path);
  if (!slices) return tl::unexpected(slices.error());
  if (auto r = check_one_series(path, *slices); !r) return tl::unexpected(r.error());
  Volume volume;
  volume.source = path;
  const auto& first = slices->front();
  volume.type = first.type;
  const std::array<std::uint64_t, 3> sizes{first.width, first.height, slices->size()};
  const auto dims = check_dims(path, sizes);
  if (!dims) return tl::unexpected(dims.error());
  volume.dims = *dims;
  if (auto r = check_alike(*slices); !r) return tl::unexpected(r.error());
  if (auto r = place(*slices, volume); !r) return tl::unexpected(r.error());

  const bool uniform = std::all_of(slices->begin(), slices->end(), [&](const DicomSlice& s) {
    return s.slope == slices->front().slope && s.intercept == slices->front().intercept;
  });
  if (uniform) {
    volume.slope = slices->front().slope;
    volume.intercept = slices->front().intercept;
  }
  const auto stacked = uniform ? stack(*slices, volume) : stack_scaled(*slices, volume);
  if (!stacked) return tl::unexpected(stacked.error());
  return volume;
}

}  // namespace slf::volume_io
