// The ray-caster's transfer function, tabulated over the values of a volume. Private to field/.
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
  /// How a value becomes an index: evenly over [low, high], or evenly over the bits of the float
  /// (constant relative precision), for functions whose points span many orders of magnitude.
  bool logarithmic = false;
  float low = 0;
  float scale = 1;           ///< entries per unit of value (even)
  std::int32_t low_key = 0;  ///< ordered bits of `low` (logarithmic)
  int shift = 0;
  std::vector<glm::vec4> colors;  ///< straight RGB, padded
  std::vector<float> opacities;   ///< of one step; as many
};

/// The bits of a float as an integer that orders as the floats do.
[[nodiscard]] std::int32_t ordered_bits(float value);

/// For stored values in `range`. An opacity o of the function becomes 1 - (1 - o)^steps_per_unit.
[[nodiscard]] TransferTable make_table(const TransferFunction& transfer, const Volume& volume,
                                       std::array<float, 2> range, double steps_per_unit);

/// An entry for each of `labels`, in order.
[[nodiscard]] TransferTable make_label_table(const TransferFunction& transfer, const Volume& volume,
                                             const std::vector<double>& labels,
                                             double steps_per_unit);

}  // namespace slf
