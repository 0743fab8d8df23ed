// ValueStatistics: statistics of a volume's values, from which transfer functions are fitted.
#pragma once

#include <array>
#include <cmath>
#include <vector>

#include "slf/transfer.h"
#include "slf/volume.h"

namespace slf {

/// The fraction of the way from one number to a greater one. Ranges of the widest doubles do not
/// overflow, and those of the smallest do not vanish.
[[nodiscard]] inline double fraction(double value, double from, double to) {
  return std::isfinite(to - from) ? (value - from) / (to - from)
                                  : (value / 2 - from / 2) / (to / 2 - from / 2);
}

struct ValueStatistics {
  /// A sorted sample of the finite values, 1 to about a million. If by_decades, logarithms (base
  /// 10) of the positive ones; if both_signs, magnitudes.
  std::vector<double> values;
  double min = 0, max = 0;  ///< range of `values` without outliers
  double threshold = 0;     ///< `values` up to this are background
  bool by_decades = false;  ///< positive values over more than four decades
  bool both_signs = false;  ///< of both signs, around a background of 0

  /// Whether all values are equal.
  [[nodiscard]] bool is_flat() const { return !(min < max); }
  /// Converts from the scale of `values` to the volume's.
  [[nodiscard]] double to_value(double of_values) const;
  /// The range of the volume's values to which a relative function is stretched.
  [[nodiscard]] std::array<double, 2> range() const;
};

[[nodiscard]] ValueStatistics value_statistics(const Volume& volume);

/// The opacities of default_transfer for volumes of amounts.
[[nodiscard]] std::vector<TransferFunction::OpacityPoint> default_opacities(
    const ValueStatistics& statistics);

/// A function for labels. An id has the colour of its point in `colors`; without such a point, that
/// of the point number id modulo their count; without `colors`, the one in the volume's own styles
/// or its default hue. 0 is clear, the others opaque.
[[nodiscard]] TransferFunction label_transfer(
    const Volume& volume, const std::vector<TransferFunction::ColorPoint>& colors = {});

/// A function for labels with the colours of a colour map, spread over the ids in the volume.
[[nodiscard]] TransferFunction label_transfer(const Volume& volume, const TransferFunction& map);

/// The edge of a cube with the volume of a voxel, in world units.
[[nodiscard]] double voxel_size(const Volume& volume);

}  // namespace slf
