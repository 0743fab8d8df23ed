// default_transfer: a function from the values alone.
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <set>
#include <span>

#include "field/volume/transfer_color.h"
#include "field/volume/voxels.h"
#include "slf/transfer.h"
#include "slf/volume.h"

namespace slf {

namespace {

// Enough for a percentile, whatever the volume's size.
constexpr std::size_t kSamples = std::size_t{1} << 20;

/// Finite values after the scale, at most about kSamples of them, evenly strided; sorted.
std::vector<double> sorted_sample(const Volume& volume) {
  std::vector<double> values;
  visit_voxels(volume, [&](auto stored) {
    // An odd stride walks through all columns of a volume whose width is a power of two.
    const std::size_t stride = (stored.size() / kSamples) | 1;
    for (std::size_t i = 0; i < stored.size(); i += stride) {
      const double value = volume.slope * static_cast<double>(stored[i]) + volume.intercept;
      if (std::isfinite(value)) values.push_back(value);
    }
  });
  std::sort(values.begin(), values.end());
  return values;
}

/// REQUIRES: sorted, not empty, q in 0..1.
double quantile(std::span<const double> sorted, double q) {
  return sorted[static_cast<std::size_t>(std::llround(q * static_cast<double>(sorted.size() - 1)))];
}

/// The value that best parts the sorted values in two classes (Otsu 1979), over 256 bins between
/// robust extremes. REQUIRES: not all equal between the extremes.
double otsu_threshold(std::span<const double> sorted, double least, double most) {
  constexpr std::size_t kBins = 256;
  std::array<double, kBins> count{};
  for (const double value : sorted) {
    // In halves, so that the range of the widest doubles does not overflow.
    const double bin = (value / 2 - least / 2) / (most / 2 - least / 2) * kBins;
    ++count[static_cast<std::size_t>(std::clamp(bin, 0.0, double{kBins - 1}))];
  }
  double total = 0, total_sum = 0;
  for (std::size_t i = 0; i < kBins; ++i) {
    total += count[i];
    total_sum += count[i] * static_cast<double>(i);
  }
  double below = 0, below_sum = 0, best = -1;
  double first = 0, last = 0;  // the bins of the best cut: empty bins between classes all tie
  for (std::size_t i = 0; i + 1 < kBins; ++i) {
    below += count[i];
    below_sum += count[i] * static_cast<double>(i);
    if (below == 0 || below == total) continue;
    const double gap = below_sum / below - (total_sum - below_sum) / (total - below);
    const double score = below * (total - below) * gap * gap;
    if (score > best) first = static_cast<double>(i);
    if (score >= best) last = static_cast<double>(i);
    best = std::max(best, score);
  }
  return std::lerp(least, most, ((first + last) / 2 + 1) / kBins);
}

glm::dvec3 ramp(double t) {
  constexpr glm::dvec3 kDark{0.35, 0.14, 0.1}, kMiddle{0.87, 0.6, 0.4}, kBright{1, 0.97, 0.9};
  return t < 0.5 ? glm::mix(kDark, kMiddle, 2 * t) : glm::mix(kMiddle, kBright, 2 * t - 1);
}

double voxel_size(const Volume& volume) {
  return std::cbrt(std::abs(glm::determinant(volume.axes)));
}

TransferFunction for_amounts(const Volume& volume) {
  TransferFunction result;
  result.name = "Default";
  result.unit_distance = voxel_size(volume);
  std::vector<double> values = sorted_sample(volume);
  if (values.empty()) values.push_back(0);
  double least = quantile(values, 0.001), most = quantile(values, 0.999);
  if (!(least < most)) least = values.front(), most = values.back();
  if (!(least < most)) {  // one value everywhere: background
    result.colors = {{least, ramp(0)}};
    result.opacities = {{least, 0, 0.5, 0}};
    return result;
  }
  // Positive values over many decades part and space out by their logarithms.
  const bool decades = least > 0 && most / least > 1e4;
  if (decades) {
    values.erase(values.begin(), std::lower_bound(values.begin(), values.end(), least));
    for (double& value : values) value = std::log10(value);
    least = std::log10(least);
    most = std::log10(most);
  }
  const double threshold = otsu_threshold(values, least, most);
  const auto first = std::upper_bound(values.begin(), values.end() - 1, threshold);
  const std::span<const double> object(first, values.end());

  // Half by value, half by rank: even where values are even, finer where there are many.
  constexpr int kSteps = 16;
  double before = -HUGE_VAL;
  for (int i = 0; i <= kSteps; ++i) {
    const double t = static_cast<double>(i) / kSteps;
    const double by_value = std::lerp(threshold, most, t);
    const double by_rank = std::clamp(quantile(object, t), threshold, most);
    double value = i == 0 ? threshold : std::midpoint(by_value, by_rank);
    if (decades) value = std::pow(10, value);
    if (!(value > before)) continue;
    before = value;
    result.colors.push_back({value, ramp(t)});
    result.opacities.push_back({value, 0.95 * t * t, 0.5, 0});
  }
  return result;
}

/// The ids there are, at most 65536 of them (more are amounts misread).
std::set<double> ids_of(const Volume& volume) {
  std::set<double> ids;
  visit_voxels(volume, [&](auto stored) {
    constexpr std::size_t kMost = 65536;
    auto before = stored[0];
    for (std::size_t i = 0; i < stored.size() && ids.size() < kMost; ++i) {
      if (i > 0 && stored[i] == before) continue;  // runs are long
      before = stored[i];
      const double id = volume.slope * static_cast<double>(before) + volume.intercept;
      if (std::isfinite(id)) ids.insert(id);
    }
  });
  return ids;
}

// In Space::step the stretch up to and with a point has the point's colour, so every id, being a
// point, has its own. The opacity leaps half way from 0 to the ids beside it.
TransferFunction for_labels(const Volume& volume) {
  TransferFunction result;
  result.name = "Default labels";
  result.space = TransferFunction::Space::step;
  result.unit_distance = voxel_size(volume);
  std::set<double> ids = ids_of(volume);
  ids.insert(0);
  for (const double id : ids) {
    constexpr double kGoldenRatio = 0.6180339887498949;
    const double turn = id * kGoldenRatio;
    const double rest = std::fmod(std::abs(id), 3);
    const glm::dvec3 hsv{turn - std::floor(turn), 0.55 + 0.15 * rest, 0.95 - 0.1 * rest};
    result.colors.push_back({id, id == 0 ? glm::dvec3(0.0) : transfer_color::hsv_to_rgb(hsv)});
  }
  constexpr double kStep = 1;
  if (*ids.begin() < 0) result.opacities.push_back({-1, 1, 0.5, kStep});
  result.opacities.push_back({0, 0, 0.5, kStep});
  if (*ids.rbegin() > 0) result.opacities.push_back({1, 1, 0.5, kStep});
  return result;
}

}  // namespace

TransferFunction default_transfer(const Volume& volume) {
  return volume.labels ? for_labels(volume) : for_amounts(volume);
}

}  // namespace slf
