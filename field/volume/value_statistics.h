// ValueStatistics: what a volume's values say about how to show it.
#pragma once

#include <array>
#include <vector>

#include "slf/transfer.h"
#include "slf/volume.h"

namespace slf {

struct ValueStatistics {
  /// Finite values, at most about a million of them, sorted; their logarithms (base 10), and only
  /// the positive ones, where by_decades; their magnitudes where both_signs. At least one.
  std::vector<double> values;
  double least = 0, most = 0;  ///< of `values`, outliers left out
  double threshold = 0;        ///< of `values`: what is at most this is background
  bool by_decades = false;     ///< positive values over more than four decades
  bool both_signs = false;     ///< of both signs, around a background of 0

  /// No two values to tell apart.
  [[nodiscard]] bool is_flat() const { return !(least < most); }
  /// From one of `values` to the volume's.
  [[nodiscard]] double to_value(double of_values) const;
  /// The volume's values that a relative function is stretched to.
  [[nodiscard]] std::array<double, 2> range() const;
};

[[nodiscard]] ValueStatistics value_statistics(const Volume& volume);

/// The opacities of default_transfer for volumes of amounts.
[[nodiscard]] std::vector<TransferFunction::OpacityPoint> default_opacities(
    const ValueStatistics& statistics);

/// A function for labels: the colours of `colors` by id (id modulo their count where an id has no
/// point), or where there are none the default hues. 0 is clear, the others opaque.
[[nodiscard]] TransferFunction label_transfer(
    const Volume& volume, const std::vector<TransferFunction::ColorPoint>& colors = {});

/// A colour map's colours, spread over the ids there are.
[[nodiscard]] TransferFunction label_transfer(const Volume& volume, const TransferFunction& map);

/// Edge of a cube with the content of a voxel.
[[nodiscard]] double voxel_size(const Volume& volume);

}  // namespace slf
