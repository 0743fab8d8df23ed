// The ray-caster's transfer function as a table over the values of a volume. Private to
// source.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <vector>

#include "slf/transfer.h"
#include "slf/volume.h"

namespace slf {

/// Colour and extinction over the stored values of a volume. Lengths are in units of the smallest
/// voxel spacing.
struct TransferTable {
  /// Optical depth per unit of length between an entry and the next, and its sum over the entries
  /// before: the integral of extinction over the position in the table (Engel et al. 2001).
  struct Integral {
    float before = 0;
    float extinction = 0;
  };
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
  /// With a light volume: the albedo of matter without a surface, and the share of the surface
  /// where the gradient is clear, which is the opacity across two voxels.
  std::vector<glm::vec4> albedos;
  std::vector<float> extinctions;   ///< at each of `colors`, at most kMaxExtinction
  std::vector<Integral> integrals;  ///< one for each of `colors`; see integrate()
  std::vector<float> color_path;    ///< how much colours change up to each, in their channels' sum
  float color_step = 0;             ///< the most by which `color_path` grows from entry to entry
  double unit_distance = 1;         ///< the length that the transfer function's opacities are for

  /// The surface of matter of opacity 1 is this dense: it absorbs all light within half a voxel.
  static constexpr double kMaxExtinction = 16;
};

/// Maps a float to an integer with the same order.
[[nodiscard]] inline std::int32_t ordered_bits(float value) {
  const auto bits = std::bit_cast<std::int32_t>(value);
  return bits >= 0 ? bits : std::numeric_limits<std::int32_t>::min() - bits;
}

/// The entry of a stored value, as the ray-caster's loop finds it.
[[nodiscard]] inline std::size_t entry_of(const TransferTable& table, float value) {
  const auto last = static_cast<float>(table.entries - 1);
  if (!table.logarithmic)
    return static_cast<std::size_t>(
        static_cast<std::int32_t>(std::clamp((value - table.low) * table.scale + 0.5f, 0.f, last)));
  const std::int64_t key = std::int64_t{ordered_bits(value)} - table.low_key;
  return std::min(static_cast<std::size_t>(std::max<std::int64_t>(key, 0) >> table.shift),
                  table.entries - 1);
}

/// The extinction of matter that has this opacity across unit_distance, and the reverse.
[[nodiscard]] double extinction_of(const TransferTable& table, double opacity);
[[nodiscard]] double opacity_of(const TransferTable& table, double extinction);

/// A table for stored values in `range`. Needs integrate() once its rows are complete.
[[nodiscard]] TransferTable make_table(const TransferFunction& transfer, const Volume& volume,
                                       std::array<float, 2> range);

/// A table with a row of one entry for each of `labels`, in order.
[[nodiscard]] TransferTable make_label_table(const TransferFunction& transfer, const Volume& volume,
                                             const std::vector<double>& labels);

/// Computes the integrals from the extinctions, and the path of colours.
void integrate(TransferTable& table);

}  // namespace slf
