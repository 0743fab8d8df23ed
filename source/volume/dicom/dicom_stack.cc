// Stacks DICOM slices to a volume, sorted by position.
#include <algorithm>
#include <cmath>
#include <span>

#include "base/try.h"
#include "source/volume/dicom/dicom.h"
#include "source/volume/io.h"
#include "source/volume/stack.h"
#include "source/volume/voxels.h"

namespace slf::volume_io {

namespace {

/// Slices may deviate from their even places by this share of a gap.
constexpr double kUneven = 0.1;

/// "2.5 mm between a.dcm and b.dcm".
std::string describe_gap(const std::vector<DicomSlice>& slices, std::size_t after) {
  const DicomSlice &a = slices[after], &b = slices[after + 1];
  return concat(height_of(b) - height_of(a), " mm between ", a.label(), " and ", b.label());
}

/// Names the gaps that are whole multiples of the smallest one, if all are: slices are missing.
std::string missing_slices(const std::vector<DicomSlice>& slices, const std::vector<double>& gaps,
                           double least) {
  std::string named;
  std::size_t missing = 0, holes = 0;
  for (std::size_t i = 0; i < gaps.size(); ++i) {
    const double multiple = std::round(gaps[i] / least);
    if (std::abs(gaps[i] - multiple * least) > kUneven * least) return {};
    if (multiple < 2) continue;
    missing += static_cast<std::size_t>(multiple) - 1;
    constexpr std::size_t kNamed = 3;
    if (++holes <= kNamed) named += (named.empty() ? "" : ", ") + describe_gap(slices, i);
  }
  return concat(missing, missing == 1 ? " slice is" : " slices are", " missing: ", named,
                holes > 3 ? ", …" : "");
}

/// A plane for each slice. Their places must be on a line, at even distances unless they are to be
/// resampled.
Result<PlaneGrid> plane_of_each(const std::vector<DicomSlice>& slices, const VolumeOptions& options,
                                Volume& volume) {
  const auto& first = slices.front();
  const auto& last = slices.back();
  PlaneGrid grid{.count = slices.size(), .origin = first.position};
  for (std::size_t i = 0; i < slices.size(); ++i) grid.plane.push_back(i);
  if (slices.size() == 1) return grid;
  const double range = height_of(last) - height_of(first);
  const glm::dvec3 along = (last.position - first.position) / range;
  std::vector<double> gaps;
  for (std::size_t i = 1; i < slices.size(); ++i) {
    const double height = height_of(slices[i]) - height_of(first);
    gaps.push_back(height_of(slices[i]) - height_of(slices[i - 1]));
    if (glm::length(slices[i].position - first.position - along * height) >
        std::max(first.spacing.x, first.spacing.y))
      return unsupported(
          slices[i].label(),
          "lies beside the line of the other slices: a volume needs a straight stack");
  }
  const double mean = range / static_cast<double>(gaps.size());
  const auto [least, most] = std::ranges::minmax_element(gaps);
  const bool even = *most - mean <= kUneven * mean && mean - *least <= kUneven * mean;
  grid.step = along * (!even && options.resample ? *least : mean);
  grid.uneven = !even && options.resample;
  if (even || grid.uneven) return grid;
  const std::string smallest = describe_gap(slices, static_cast<std::size_t>(least - gaps.begin()));
  const std::string largest = describe_gap(slices, static_cast<std::size_t>(most - gaps.begin()));
  if (options.spacing) {
    volume.notes.push_back("slices are not evenly spaced (" + smallest + ", " + largest +
                           "), but taken as such, at the spacing that was given");
    return grid;
  }
  const std::string missing = missing_slices(slices, gaps, *least);
  return fail_without("resample", ErrorCode::bad_file, volume.source,
                      ": slices are not evenly spaced: ", smallest, ", but ",
                      missing.empty() ? largest : missing, missing.empty() ? "" : "; find them",
                      ", or resample the volume to even spacing");
}

/// Linear interpolation, or nearest, between the slices of an uneven stack.
template <class T>
void resample_as(std::vector<std::byte>& voxels, std::size_t plane, std::size_t planes,
                 const std::vector<double>& heights, double gap, bool nearest) {
  std::vector<std::byte> even(planes * plane * sizeof(T));
  const auto* from = reinterpret_cast<const T*>(voxels.data());
  auto* to = reinterpret_cast<T*>(even.data());
  std::size_t below = 0;
  for (std::size_t k = 0; k < planes; ++k) {
    const double at = std::min(heights[0] + gap * static_cast<double>(k), heights.back());
    while (below + 2 < heights.size() && heights[below + 1] <= at) ++below;
    double share = (at - heights[below]) / (heights[below + 1] - heights[below]);
    if (nearest) share = std::round(share);
    for (std::size_t i = 0; i < plane; ++i) {
      const double a = static_cast<double>(from[below * plane + i]);
      const double b = static_cast<double>(from[(below + 1) * plane + i]);
      const double value = a + share * (b - a);
      to[k * plane + i] = static_cast<T>(std::is_integral_v<T> ? std::round(value) : value);
    }
  }
  voxels = std::move(even);
}

Result<void> resample(const std::vector<DicomSlice>& slices, bool nearest, Volume& volume) {
  std::vector<double> heights(slices.size());
  std::ranges::transform(slices, heights.begin(), height_of);
  const glm::dvec3 normal = glm::cross(slices[0].row, slices[0].column);
  const double gap = glm::dot(normal, volume.axes[2]);
  const double planes = std::floor((heights.back() - heights.front()) / gap + 1e-3) + 1;
  constexpr double kMost = 64;
  if (planes > kMost * static_cast<double>(slices.size()))
    return unsupported(volume.source, "resampled to the smallest distance, ", gap, " mm, ",
                       slices.size(), " slices would become ", planes);
  const std::size_t plane = std::size_t{volume.dims[0]} * volume.dims[1];
  visit_voxels(volume, [&](auto voxels) {
    using T = std::remove_const_t<typename decltype(voxels)::element_type>;
    resample_as<T>(volume.voxels, plane, static_cast<std::size_t>(planes), heights, gap, nearest);
  });
  volume.dims[2] = static_cast<std::uint32_t>(planes);
  volume.notes.push_back(concat("resampled from ", slices.size(), " unevenly spaced slices to ",
                                planes, ", ", gap, " mm apart"));
  return {};
}

/// Copies a slice's pixels to its plane: unchanged or, if the slices' scales differ, as f32 with
/// the scale applied.
void copy_plane(const DicomSlice& slice, std::vector<std::byte> pixels, std::span<std::byte> to,
                ScalarType type) {
  if (slice.component_type() != type) {
    Volume one;
    one.type = slice.component_type();
    one.voxels = std::move(pixels);
    pixels.clear();
    visit_voxels(one, [&](auto stored) {
      for (const auto value : stored) {
        const auto scaled =
            static_cast<float>(slice.slope * static_cast<double>(value) + slice.intercept);
        const auto bytes = std::as_bytes(std::span(&scaled, 1));
        pixels.insert(pixels.end(), bytes.begin(), bytes.end());
      }
    });
  }
  std::copy(pixels.begin(), pixels.end(), to.begin());
}

/// Fills the voxels; slice i is plane `planes[i]`. Allocates memory for all only after the first
/// file has yielded its pixels.
Result<void> fill(const std::vector<DicomSlice>& slices, const std::vector<std::size_t>& planes,
                  const VolumeOptions& options, Volume& volume) {
  const auto& first = slices.front();
  const auto selector = SLF_TRY(ComponentSelector::make(
      volume.source, {first.width, first.height, first.components(), first.component_type()},
      options));
  return for_each_frame(
      slices, [&](std::size_t i, const std::vector<std::byte>& pixels) -> Result<void> {
        std::vector<std::byte> chosen;
        SLF_TRY(selector.append(pixels, chosen));
        volume.voxels.resize(voxel_bytes(volume));
        const std::size_t bytes = volume.voxels.size() / volume.dims[2];
        copy_plane(slices[i], std::move(chosen),
                   std::span(volume.voxels).subspan(planes[i] * bytes, bytes), volume.type);
        return {};
      });
}

}  // namespace

Result<PlaneGrid> grid_of_planes(const std::vector<DicomSlice>& slices, const std::string& source) {
  std::vector<const DicomSlice*> sorted(slices.size());
  std::ranges::transform(slices, sorted.begin(), [](const auto& slice) { return &slice; });
  std::ranges::stable_sort(sorted, [](auto* a, auto* b) { return height_of(*a) < height_of(*b); });
  const DicomSlice& lowest = *sorted.front();
  const double from = height_of(lowest), range = height_of(*sorted.back()) - from;
  double least = range;
  for (std::size_t i = 1; i < sorted.size(); ++i)
    if (const double gap = height_of(*sorted[i]) - height_of(*sorted[i - 1]);
        gap > 0.01 * lowest.spacing.x)
      least = std::min(least, gap);
  const auto is_multiple = [&](double gap) {
    return std::ranges::all_of(slices, [&](const DicomSlice& slice) {
      const double at = (height_of(slice) - from) / gap;
      return std::abs(at - std::round(at)) <= kUneven;
    });
  };
  PlaneGrid grid;
  double gap = lowest.stated_gap > 0 && is_multiple(lowest.stated_gap) ? lowest.stated_gap : least;
  if (gap <= 0.01 * lowest.spacing.x) gap = lowest.spacing.x;
  const double planes = std::round(range / gap) + 1;
  constexpr double kSparse = 1000;
  if (!is_multiple(gap) || planes > kSparse * static_cast<double>(slices.size()))
    return bad_file(source, slices.size(), " frames lie within ", range,
                    " mm, not all at multiples of ", gap, " mm");
  grid.count = static_cast<std::size_t>(planes);
  grid.origin = lowest.position;
  grid.step = range > 0 ? (sorted.back()->position - lowest.position) * (gap / range)
                        : glm::cross(lowest.row, lowest.column) * gap;
  for (const auto& slice : slices)
    grid.plane.push_back(static_cast<std::size_t>(std::lround((height_of(slice) - from) / gap)));
  // A volume has two planes at least, and what was left out is empty.
  if (grid.count == 1) {
    grid.count = 3;
    grid.origin -= grid.step;
    for (auto& plane : grid.plane) ++plane;
  }
  return grid;
}

Result<void> place_in(const PlaneGrid& grid, const DicomSlice& first, Volume& volume) {
  volume.dims = SLF_TRY(check_dims(volume.source, {first.width, first.height, grid.count}));
  volume.axes = {first.row * first.spacing.x, first.column * first.spacing.y, grid.step};
  volume.origin = grid.origin;
  volume.patient_axes = first.placed;
  return check_axes(volume);
}

Result<Volume> read_dicom_stack(const std::string& source, const DicomStack& stack,
                                const VolumeOptions& options) {
  const auto& segmentation = stack.slices.front().segmentation;
  if (segmentation && segmentation->kind != DicomSegmentation::Kind::label_map)
    return read_segmentation(source, stack, options);
  auto sorted = SLF_TRY(sort_by_place(stack, options.spacing));
  Volume volume{.source = source, .private_name = true, .notes = sorted.notes};
  for (const auto& slice : stack.slices)
    if (!slice.problem && (volume.files.empty() || volume.files.back() != slice.path))
      volume.files.push_back(slice.path);

  const auto time = SLF_TRY(choose(source, options.time, sorted.time_count(), "time point"));
  if (time < sorted.times.size() && !sorted.times[time].empty())
    volume.notes.push_back(
        concat("time point ", time, " of ", sorted.time_count(), ": ", sorted.times[time]));
  std::vector<DicomSlice> slices;
  for (const auto& place : sorted.places) {
    slices.push_back(place[time]);
    if (options.labels) slices.back().keep_indices();
  }
  const DicomSlice& first = slices.front();

  // Files of labels may leave out empty planes.
  const bool sparse = segmentation || (options.labels && first.stated_gap > 0);
  const auto grid =
      SLF_TRY(sparse ? grid_of_planes(slices, source) : plane_of_each(slices, options, volume));
  SLF_TRY(place_in(grid, first, volume));
  volume.unit = "mm";
  volume.value_unit = first.value_unit;

  const bool uniform = std::ranges::all_of(slices, [&](const DicomSlice& s) {
    return s.slope == first.slope && s.intercept == first.intercept;
  });
  volume.type = uniform ? first.component_type() : ScalarType::f32;
  if (uniform) {
    volume.slope = first.slope;
    volume.intercept = first.intercept;
  }
  if (first.least_is_white && !segmentation)
    volume.notes.emplace_back(
        "MONOCHROME1: pictures show the least values white; here values stay as they are, so that "
        "a transfer function of the modality fits");
  if (segmentation) {
    volume.labels = true;
    volume.label_styles = segmentation->segments;
  }
  SLF_TRY(fill(slices, grid.plane, options, volume));
  if (grid.uneven) SLF_TRY(resample(slices, options.labels, volume));
  return volume;
}

}  // namespace slf::volume_io
