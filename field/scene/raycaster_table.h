// The ray-caster's transfer function as a table over the values of a volume. Private to
// field/scene.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "slf/transfer.h"
#include "slf/volume.h"

namespace slf {

/// Colour and step-corrected opacity over the stored values of a volume.
struct TransferTable {
  /// How values map to indices: evenly over [low, high], or evenly over the bits of the float. The
  /// latter has constant relative precision, for functions that span many orders of magnitude.
  bool logarithmic = false;
  float low = 0;
  float scale = 1;           ///< entries per unit of value (even)
  std::int32_t low_key = 0;  ///< ordered bits of `low` (logarithmic)
  int shift = 0;
  /// Entries of a row. There is one row, or one for each structure; the first is the function's
  /// own.
  std::size_t entries = 0;
  std::vector<glm::vec4> colors;  ///< straight RGB, padded, row by row
  std::vector<float> opacities;   ///< of one step; one for each of `colors`
};

/// Maps a float to an integer with the same order.
[[nodiscard]] std::int32_t ordered_bits(float value);

/// The entry of a stored value, as the ray-caster's loop finds it.
[[nodiscard]] std::size_t entry_of(const TransferTable& table, float value);

/// A table for stored values in `range`. An opacity o becomes 1 - (1 - o)^steps_per_unit.
[[nodiscard]] TransferTable make_table(const TransferFunction& transfer, const Volume& volume,
                                       std::array<float, 2> range, double steps_per_unit);

/// A table with one entry for each of `labels`, in order.
[[nodiscard]] TransferTable make_label_table(const TransferFunction& transfer, const Volume& volume,
                                             const std::vector<double>& labels,
                                             double steps_per_unit);

}  // namespace slf
