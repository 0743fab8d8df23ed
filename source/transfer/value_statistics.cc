#include "source/transfer/value_statistics.h"

#include <algorithm>
#include <numeric>
#include <span>

#include "source/volume/voxels.h"

namespace slf {

namespace {

// Enough for quantiles of a volume of any size.
constexpr std::size_t kSamples = std::size_t{1} << 20;
constexpr std::size_t kBins = 256;

/// Finite values after the scale, at most about kSamples of them, evenly strided; sorted.
std::vector<double> sorted_sample(const Volume& volume) {
  std::vector<double> values;
  const auto add = [&](auto stored, std::size_t times) {
    const double value = volume.slope * static_cast<double>(stored) + volume.intercept;
    if (std::isfinite(value)) values.insert(values.end(), times, value);
  };
  visit_voxels(volume, [&]<class T>(std::span<const T> stored) {
    // An odd stride visits all columns of a volume whose width is a power of two.
    const std::size_t stride = (stored.size() / kSamples) | 1;
    values.reserve(stored.size() / stride + 1);
    if constexpr (sizeof(T) <= 2) {  // counting is many times faster than sorting
      using Limits = std::numeric_limits<T>;
      std::vector<std::size_t> count(std::size_t{1} << 8 * sizeof(T));
      const auto index = [](int k) { return static_cast<std::size_t>(k - Limits::min()); };
      for (std::size_t i = 0; i < stored.size(); i += stride) ++count[index(stored[i])];
      for (std::size_t k = 0; k < count.size(); ++k)
        add(static_cast<int>(k) + Limits::min(), count[k]);
    } else {
      for (std::size_t i = 0; i < stored.size(); i += stride) add(stored[i], 1);
    }
  });
  if (!std::ranges::is_sorted(values)) std::ranges::sort(values);
  return values;
}

/// REQUIRES: sorted, not empty, q in 0..1.
double quantile(std::span<const double> sorted, double q) {
  return sorted[static_cast<std::size_t>(std::llround(q * static_cast<double>(sorted.size() - 1)))];
}

/// Counts of values over equal bins; those outside go to the first and the last.
/// REQUIRES: min < max.
std::array<double, kBins> histogram(std::span<const double> values, double min, double max) {
  std::array<double, kBins> count{};
  for (const double value : values) {
    const double bin = fraction(value, min, max) * kBins;
    ++count[static_cast<std::size_t>(std::clamp(bin, 0.0, double{kBins - 1}))];
  }
  return count;
}

struct Threshold {
  double value;         ///< threshold that separates the values best into two classes
  double separability;  ///< the variance between the classes over all variance, 0..1
};

/// Otsu 1979, over bins between two values. REQUIRES: sorted, min < max.
Threshold otsu(std::span<const double> values, double min, double max) {
  const auto count = histogram(values, min, max);
  double total = 0, sum = 0, squares = 0;
  for (std::size_t i = 0; i < kBins; ++i) {
    const auto at = static_cast<double>(i);
    total += count[i];
    sum += count[i] * at;
    squares += count[i] * at * at;
  }
  double below = 0, below_sum = 0, best = -1;
  double first = 0, last = 0;  // the bins of the best cut: empty bins between classes all tie
  for (std::size_t i = 0; i + 1 < kBins; ++i) {
    below += count[i];
    below_sum += count[i] * static_cast<double>(i);
    if (below == 0 || below == total) continue;
    const double gap = below_sum / below - (sum - below_sum) / (total - below);
    const double score = below * (total - below) * gap * gap;
    if (score > best) first = static_cast<double>(i);
    if (score >= best) last = static_cast<double>(i);
    best = std::max(best, score);
  }
  const double variance = squares / total - (sum / total) * (sum / total);
  return {std::lerp(min, max, ((first + last) / 2 + 1) / kBins),
          variance > 0 ? best / (total * total) / variance : 0};
}

/// Whether values of both signs surround a background of 0: 0 is in the fullest bin, and each side
/// has at least 5 % of the other's extent.
bool is_around_zero(std::span<const double> sorted, double min, double max) {
  if (!(min < 0 && max > 0) || std::min(-min, max) < 0.05 * std::max(-min, max)) return false;
  const auto count = histogram(sorted, min, max);
  const double zero = fraction(0, min, max) * kBins;
  // The bin of 0 or a neighbour, in case 0 is at the edge of its bin.
  const auto fullest = std::max_element(count.begin() + 1, count.end() - 1) - count.begin();
  return std::abs(static_cast<double>(fullest) + 0.5 - zero) <= 1.5;
}

double share_of_zero(std::span<const double> sorted) {
  const auto [first, last] = std::equal_range(sorted.begin(), sorted.end(), 0.0);
  return static_cast<double>(last - first) / static_cast<double>(sorted.size());
}

/// The value at which the background ends: Otsu's threshold. If that only separates a few very
/// bright voxels (PET: bladder, heart) from the rest, the rest is split again, at most twice.
double background_end(std::span<const double> sorted, double min, double max) {
  constexpr double kFew = 0.05, kParts = 0.7;
  double end = otsu(sorted, min, max).value;
  for (int again = 0; again < 2; ++again) {
    const auto above = std::ranges::upper_bound(sorted, end);
    if (static_cast<double>(sorted.end() - above) > kFew * static_cast<double>(sorted.size()))
      break;
    const std::span<const double> rest(sorted.begin(), above);
    if (rest.empty() || !(min < end)) break;
    const Threshold lower = otsu(rest, min, end);
    if (lower.separability < kParts || !(lower.value > min)) break;
    end = lower.value;
  }
  return end;
}

}  // namespace

double ValueStatistics::to_value(double of_values) const {
  return by_decades ? std::pow(10, of_values) : of_values;
}

std::array<double, 2> ValueStatistics::range() const {
  return {both_signs ? -max : to_value(min), to_value(max)};
}

ValueStatistics value_statistics(const Volume& volume) {
  ValueStatistics s;
  s.values = sorted_sample(volume);
  if (s.values.empty()) s.values.push_back(0);
  s.min = quantile(s.values, 0.001);
  s.max = quantile(s.values, 0.999);
  if (s.is_flat()) s.min = s.values.front(), s.max = s.values.back();
  if (s.is_flat()) return s;
  s.both_signs = is_around_zero(s.values, s.min, s.max);
  if (s.both_signs) {
    // In a masked volume exact zeros are background and all else is signal. Otherwise noise is
    // background, too.
    const bool masked = share_of_zero(s.values) > 0.1;
    s.max = std::max(-s.min, s.max);
    s.min = 0;
    for (double& value : s.values) value = std::abs(value);
    std::ranges::sort(s.values);
    s.threshold = masked ? 0 : otsu(s.values, s.min, s.max).value;
    return s;
  }
  s.by_decades = s.min > 0 && s.max / s.min > 1e4;
  if (s.by_decades) {
    s.values.erase(s.values.begin(), std::ranges::lower_bound(s.values, s.min));
    for (double& value : s.values) value = std::log10(value);
    s.min = std::log10(s.min);
    s.max = std::log10(s.max);
  }
  s.threshold = background_end(s.values, s.min, s.max);
  return s;
}

namespace {

struct Step {
  double value;  ///< of statistics.values
  double t;      ///< 0 at the threshold, 1 at the greatest
};

/// The points of the default function: means of equal steps in value and equal steps in rank, so
/// they are denser where values are frequent.
std::vector<Step> steps_above_threshold(const ValueStatistics& s) {
  const auto first = std::upper_bound(s.values.begin(), s.values.end() - 1, s.threshold);
  const std::span<const double> object(first, s.values.end());
  constexpr int kSteps = 16;
  std::vector<Step> steps;
  for (int i = 0; i <= kSteps; ++i) {
    const double t = static_cast<double>(i) / kSteps;
    const double by_value = std::lerp(s.threshold, s.max, t);
    const double by_rank = std::clamp(quantile(object, t), s.threshold, s.max);
    const double value = i == 0         ? s.threshold
                         : s.both_signs ? by_value
                                        : std::midpoint(by_value, by_rank);
    if (steps.empty() || value > steps.back().value) steps.push_back({value, t});
  }
  return steps;
}

glm::dvec3 along(const std::array<glm::dvec3, 3>& colors, double t) {
  return t < 0.5 ? glm::mix(colors[0], colors[1], 2 * t)
                 : glm::mix(colors[1], colors[2], 2 * t - 1);
}

constexpr std::array<glm::dvec3, 3> kAmount{{{0.35, 0.14, 0.1}, {0.87, 0.6, 0.4}, {1, 0.97, 0.9}}};
constexpr std::array<glm::dvec3, 3> kAbove{{{0.55, 0.1, 0.08}, {0.96, 0.4, 0.1}, {1, 0.95, 0.5}}};
constexpr std::array<glm::dvec3, 3> kBelow{{{0.12, 0.18, 0.6}, {0.1, 0.5, 0.95}, {0.6, 0.97, 1}}};

TransferFunction for_amounts(const Volume& volume) {
  TransferFunction result;
  result.name = "Default";
  result.unit_distance = voxel_size(volume);
  const ValueStatistics s = value_statistics(volume);
  result.opacities = default_opacities(s);
  if (s.is_flat()) {
    result.colors = {{s.min, kAmount[0]}};
    return result;
  }
  const auto steps = steps_above_threshold(s);
  if (s.both_signs)
    for (auto step = steps.rbegin(); step != steps.rend(); ++step)
      result.colors.push_back({-step->value, along(kBelow, step->t)});
  double before = -HUGE_VAL;
  for (const Step& step : steps) {
    const double value = s.to_value(step.value);
    if (!(value > before)) continue;
    before = value;
    result.colors.push_back({value, along(s.both_signs ? kAbove : kAmount, step.t)});
  }
  return result;
}

}  // namespace

std::vector<TransferFunction::OpacityPoint> default_opacities(const ValueStatistics& s) {
  if (s.is_flat()) return {{s.min, 0, 0.5, 0}};  // one value everywhere: background
  std::vector<TransferFunction::OpacityPoint> points;
  const auto steps = steps_above_threshold(s);
  if (s.both_signs)
    for (auto step = steps.rbegin(); step != steps.rend(); ++step)
      if (step->value > 0) points.push_back({-step->value, 0.95 * step->t * step->t, 0.5, 0});
  for (const auto& [of_values, t] : steps) {
    const double value = s.to_value(of_values);
    if (points.empty() || value > points.back().value)
      points.push_back({value, 0.95 * t * t, 0.5, 0});
  }
  return points;
}

double voxel_size(const Volume& volume) {
  return std::cbrt(std::abs(glm::determinant(volume.axes)));
}

TransferFunction default_transfer(const Volume& volume) {
  return volume.labels ? label_transfer(volume) : for_amounts(volume);
}

}  // namespace slf
