#include "source/medium/transfer_table.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

namespace slf {
namespace {

void add_entry(TransferTable& table, const TransferFunction& transfer, double value) {
  const glm::dvec4 entry = transfer(value);
  table.colors.push_back(glm::vec4(entry));
  ++table.entries;
  table.extinctions.push_back(static_cast<float>(extinction_of(table, entry.a)));
}

TransferTable empty_table(const TransferFunction& transfer, const Volume& volume) {
  const glm::dvec3 spacing = volume.spacing();
  TransferTable table;
  table.unit_distance = transfer.unit_distance / std::min({spacing.x, spacing.y, spacing.z});
  return table;
}

/// The smallest distance between neighbouring points of the function. A table must resolve it.
double min_gap(const TransferFunction& transfer) {
  double gap = std::numeric_limits<double>::max();
  const auto measure = [&](const auto& points) {
    for (std::size_t k = 1; k < points.size(); ++k)
      if (const double g = points[k].value - points[k - 1].value; g > 0) gap = std::min(gap, g);
  };
  measure(transfer.colors);
  measure(transfer.opacities);
  return gap;
}

}  // namespace

double extinction_of(const TransferTable& table, double opacity) {
  const double extinction = -std::log1p(-std::clamp(opacity, 0.0, 1.0)) / table.unit_distance;
  return std::min(extinction, TransferTable::kMaxExtinction);
}

double opacity_of(const TransferTable& table, double extinction) {
  return -std::expm1(-extinction * table.unit_distance);
}

TransferTable make_table(const TransferFunction& transfer, const Volume& volume,
                         std::array<float, 2> range) {
  constexpr int kMaxEntries = 1 << 16;
  TransferTable table = empty_table(transfer, volume);
  const auto [low, high] = range;
  table.low = low;
  const double width = std::max(double{high} - low, 1e-30);
  // Use 16 entries for the narrowest ramp, and at least 4 for each integer value.
  const double wanted = 16 * width * std::abs(volume.slope) / min_gap(transfer);
  const bool integers = volume.type != ScalarType::f32;
  const auto add = [&](double stored) {
    add_entry(table, transfer, volume.slope * stored + volume.intercept);
  };
  if (integers || wanted <= kMaxEntries) {
    const int size = static_cast<int>(
        std::clamp(std::max(wanted, integers ? 4 * width : 0.0), 1024.0, double{kMaxEntries}));
    table.scale = static_cast<float>((size - 1) / width);
    for (int k = 0; k < size; ++k) add(low + width * k / (size - 1));
    return table;
  }
  table.logarithmic = true;
  table.low_key = ordered_bits(low);
  const std::int64_t keys = std::int64_t{ordered_bits(high)} - table.low_key;
  while ((keys >> table.shift) >= kMaxEntries) ++table.shift;
  for (std::int64_t k = 0; k <= keys >> table.shift; ++k) {
    const std::int64_t key =
        table.low_key +
        std::min(keys, (k << table.shift) + ((std::int64_t{1} << table.shift) >> 1));
    const auto ordered = static_cast<std::int32_t>(key);
    add(std::bit_cast<float>(ordered >= 0 ? ordered
                                          : std::numeric_limits<std::int32_t>::min() - ordered));
  }
  return table;
}

TransferTable make_label_table(const TransferFunction& transfer, const Volume& volume,
                               const std::vector<double>& labels) {
  TransferTable table = empty_table(transfer, volume);
  for (const double label : labels)
    add_entry(table, transfer, volume.slope * label + volume.intercept);
  table.entries = 1;
  return table;
}

void integrate(TransferTable& table) {
  table.integrals.resize(table.extinctions.size());
  table.color_path.resize(table.colors.size());
  for (std::size_t row = 0; row < table.extinctions.size(); row += table.entries) {
    double before = 0, path = 0;
    for (std::size_t k = row; k < row + table.entries; ++k) {
      const std::size_t next = std::min(k + 1, row + table.entries - 1);
      const double mean = (double{table.extinctions[k]} + table.extinctions[next]) / 2;
      table.integrals[k] = {static_cast<float>(before), static_cast<float>(mean)};
      before += mean;
      table.color_path[k] = static_cast<float>(path);
      const glm::vec4 change = glm::abs(table.colors[next] - table.colors[k]);
      const float step = change.r + change.g + change.b;
      table.color_step = std::max(table.color_step, step);
      path += step;
    }
  }
}

}  // namespace slf
