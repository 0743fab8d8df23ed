// TransferPreset::fit: fits a preset to a volume.
#include <algorithm>
#include <cmath>

#include "source/transfer/transfer_formats.h"
#include "source/transfer/value_statistics.h"

namespace slf {

namespace transfer_formats {

std::vector<TransferFunction::OpacityPoint> opacity_ramp(double from, double to) {
  constexpr int kSteps = 8;
  std::vector<TransferFunction::OpacityPoint> points;
  for (int i = 0; i <= kSteps; ++i) {
    const double t = static_cast<double>(i) / kSteps;
    const double value = std::lerp(from, to, t);
    if (points.empty() || value > points.back().value)
      points.push_back({value, 0.95 * t * t, 0.5, 0});
  }
  return points;
}

std::array<double, 2> extent(const TransferPreset& preset) {
  const auto& f = preset.function;
  std::array<double, 2> all{f.colors.front().value, f.colors.back().value};
  if (preset.has_opacity) {
    all[0] = std::min(all[0], f.opacities.front().value);
    all[1] = std::max(all[1], f.opacities.back().value);
  }
  return all;
}

}  // namespace transfer_formats

namespace {

using Values = TransferPreset::Values;
using Extent = std::array<double, 2>;

/// Moves the points of an extent to another, linearly.
template <class Point>
void stretch(std::vector<Point>& points, const Extent& from, const Extent& to) {
  for (auto& point : points) {
    const double share = from[0] < from[1] ? fraction(point.value, from[0], from[1]) : 1;
    point.value = std::lerp(to[0], to[1], share);
  }
}

/// Maps a function from an extent to a range, at points that are even in the logarithm of the
/// range.
TransferFunction by_decades(const TransferFunction& function, const Extent& from,
                            const Extent& to) {
  TransferFunction result = function;
  result.space = TransferFunction::Space::rgb;
  result.colors.clear();
  result.opacities.clear();
  constexpr int kSteps = 64;
  for (int i = 0; i <= kSteps; ++i) {
    const double t = static_cast<double>(i) / kSteps;
    const double value = std::pow(10, std::lerp(std::log10(to[0]), std::log10(to[1]), t));
    const glm::dvec4 rgba = function(std::lerp(from[0], from[1], t));
    if (!result.colors.empty() && !(value > result.colors.back().value)) continue;
    result.colors.push_back({value, glm::dvec3(rgba)});
    result.opacities.push_back({value, rgba.w, 0.5, 0});
  }
  return result;
}

/// Spreads the colours of categories over an extent in equal steps. In Space::step a point's colour
/// is that of all values up to the point.
void spread_evenly(std::vector<TransferFunction::ColorPoint>& colors, const Extent& to) {
  const auto count = static_cast<double>(colors.size());
  for (std::size_t i = 0; i < colors.size(); ++i)
    colors[i].value = std::lerp(to[0], to[1], static_cast<double>(i + 1) / count);
}

bool is_normalized(const Extent& extent) {
  return (extent[0] == 0 || extent[0] == -1) && extent[1] == 1;
}

/// Whether the volume's values exceed the extent by more than its length. Then the extent cannot be
/// in the volume's units.
bool is_far_beyond(const ValueStatistics& statistics, const Extent& extent) {
  const Extent range = statistics.range();
  const double length = extent[1] - extent[0];
  return range[1] > extent[1] + length || range[0] < extent[0] - length;
}

}  // namespace

TransferFunction TransferPreset::fit(const Volume& volume,
                                     const std::optional<std::array<double, 2>>& range) const {
  const Extent own = transfer_formats::extent(*this);
  if (volume.labels && !has_opacity) {
    TransferFunction result = values == Values::indexed ? label_transfer(volume, function.colors)
                                                        : label_transfer(volume, function);
    result.name = function.name;
    return result;
  }
  TransferFunction result = function;
  if (!has_unit_distance) result.unit_distance = voxel_size(volume);
  if (range) {
    if (values == Values::indexed)
      spread_evenly(result.colors, *range);
    else
      stretch(result.colors, own, *range);
    if (has_opacity)
      stretch(result.opacities, own, *range);
    else
      result.opacities = transfer_formats::opacity_ramp((*range)[0], (*range)[1]);
    return result;
  }
  if (values == Values::absolute && has_opacity && !is_normalized(own)) return result;

  const ValueStatistics statistics = value_statistics(volume);
  const bool relative = values == Values::relative || values == Values::indexed ||
                        (is_normalized(own) && (!has_opacity || is_far_beyond(statistics, own)));
  Extent to = statistics.range();
  if (!(to[0] < to[1])) to[1] = to[0] + 1;  // one value everywhere
  if (values == Values::indexed) {
    spread_evenly(result.colors, to);
  } else if (relative && statistics.by_decades) {
    result = by_decades(result, own, to);
  } else if (relative) {
    stretch(result.colors, own, to);
    stretch(result.opacities, own, to);
  }
  if (!has_opacity) result.opacities = default_opacities(statistics);
  return result;
}

}  // namespace slf
