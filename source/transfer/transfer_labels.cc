// Transfer functions for labels, and the guess whether a volume holds labels.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>

#include "source/transfer/transfer_color.h"
#include "source/transfer/value_statistics.h"
#include "source/volume/voxels.h"

namespace slf {

namespace {

/// The ids in a volume, at most 65536. (A volume with more holds amounts, not ids.)
std::set<double> ids_of(const Volume& volume) {
  std::set<double> ids;
  visit_voxels(volume, [&](auto stored) {
    constexpr std::size_t kMaxLabels = 65536;
    auto before = stored[0];
    for (std::size_t i = 0; i < stored.size() && ids.size() < kMaxLabels; ++i) {
      if (i > 0 && stored[i] == before) continue;  // runs are long
      before = stored[i];
      const double id = volume.slope * static_cast<double>(before) + volume.intercept;
      if (std::isfinite(id)) ids.insert(id);
    }
  });
  return ids;
}

}  // namespace

std::set<std::int64_t> label_ids(const Volume& volume) {
  std::set<std::int64_t> ids;
  for (const double id : ids_of(volume)) ids.insert(std::llround(id));
  return ids;
}

glm::dvec3 transfer_color::of_label(double id) {
  constexpr double kGoldenRatio = 0.6180339887498949;
  const double turn = id * kGoldenRatio;
  const double rest = std::fmod(std::abs(id), 3);
  return transfer_color::hsv_to_rgb(
      {turn - std::floor(turn), 0.55 + 0.15 * rest, 0.95 - 0.1 * rest});
}

namespace {

// Each id is a point, and in Space::step values up to a point have its colour. The opacity steps
// from 0 to 1 halfway between id 0 and the ids beside it.
template <class ColorOf>
TransferFunction with_colors(const Volume& volume, const ColorOf& color_of) {
  TransferFunction result;
  result.name = "Default labels";
  result.space = TransferFunction::Space::step;
  result.unit_distance = voxel_size(volume);
  std::set<double> ids = ids_of(volume);
  ids.insert(0);
  std::size_t rank = 0;
  for (const double id : ids) {
    const double share = ids.size() > 2 ? double(rank) / double(ids.size() - 2) : 0.5;
    result.colors.push_back({id, id == 0 ? glm::dvec3(0.0) : color_of(id, share)});
    if (id != 0) ++rank;
  }
  constexpr double kStep = 1;
  const auto opacity_of = [&](double id) {
    const auto style = volume.label_styles.find(std::llround(id));
    return style == volume.label_styles.end() ? 1 : style->second.opacity;
  };
  if (std::ranges::any_of(ids, [&](double id) { return opacity_of(id) != 1; })) {
    for (const double id : ids)
      result.opacities.push_back({id, id == 0 ? 0 : opacity_of(id), 0.5, kStep});
    return result;
  }
  if (*ids.begin() < 0) result.opacities.push_back({-1, 1, 0.5, kStep});
  result.opacities.push_back({0, 0, 0.5, kStep});
  if (*ids.rbegin() > 0) result.opacities.push_back({1, 1, 0.5, kStep});
  return result;
}

}  // namespace

TransferFunction label_transfer(const Volume& volume,
                                const std::vector<TransferFunction::ColorPoint>& colors) {
  return with_colors(volume, [&](double id, double) {
    if (colors.empty()) {
      for (const auto& [own, style] : volume.label_styles)
        if (static_cast<double>(own) == id && style.color) return *style.color;
      return transfer_color::of_label(id);
    }
    const auto found =
        std::ranges::find_if(colors, [&](const auto& point) { return point.value == id; });
    if (found != colors.end()) return found->rgb;
    const auto count = static_cast<double>(colors.size());
    const double rest = std::fmod(std::fmod(std::floor(id), count) + count, count);
    return colors[static_cast<std::size_t>(rest)].rgb;
  });
}

TransferFunction label_transfer(const Volume& volume, const TransferFunction& map) {
  const double from = map.colors.front().value, to = map.colors.back().value;
  return with_colors(
      volume, [&](double, double share) { return glm::dvec3(map(std::lerp(from, to, share))); });
}

bool looks_like_labels(const Volume& volume) {
  if (std::trunc(volume.slope) != volume.slope || std::trunc(volume.intercept) != volume.intercept)
    return false;
  return visit_voxels(volume, [&](auto stored) {
    using T = typename decltype(stored)::value_type;
    // Counts pairs of neighbours along x inside objects. Pairs of zeros are background: ignored.
    std::uint64_t equal = 0, near = 0, far = 0;
    const std::size_t width = volume.dims[0];
    const std::size_t rows = stored.empty() ? 0 : stored.size() / width;
    const std::size_t stride = (rows / 65536) | 1;
    for (std::size_t row = 0; row < rows; row += stride)
      for (std::size_t i = row * width + 1; i < (row + 1) * width; ++i) {
        const T a = stored[i - 1], b = stored[i];
        if constexpr (std::is_floating_point_v<T>)
          if (!(std::trunc(b) == b)) return false;
        if (a == b)
          equal += a != T{0};
        else if (a != T{0} && b != T{0})
          (std::abs(static_cast<double>(a) - static_cast<double>(b)) <= 1 ? near : far) += 1;
        else
          far += 1;
      }
    const auto inside = static_cast<double>(equal + near + far);
    // Amounts often differ a little between neighbours; ids seldom differ, but then by any number.
    return far > 0 && static_cast<double>(equal) > 0.7 * inside && near <= far;
  });
}

}  // namespace slf
