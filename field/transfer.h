// TransferFunction: from a volume's value to colour and opacity.
//
// Reads ParaView's preset JSON. Values are in the volume's own units; opacity is per
// `unit_distance` world units and must be corrected for the step actually taken:
// 1 - (1 - opacity)^(step / unit_distance).
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "base/error.h"

namespace slf {

struct Volume;

class TransferFunction {
 public:
  /// Colour at a value; between two points interpolated in the preset's colour space.
  struct ColorPoint {
    double value;
    glm::dvec3 rgb;
  };
  /// Opacity at a value, with ParaView's midpoint and sharpness for the way to the next point.
  struct OpacityPoint {
    double value, opacity, midpoint, sharpness;
  };
  enum class Space { rgb, hsv, lab, diverging, step };

  std::string name;
  Space space = Space::rgb;
  std::vector<ColorPoint> colors;       ///< ascending in value, at least one
  std::vector<OpacityPoint> opacities;  ///< ascending in value, at least one
  double unit_distance = 1;             ///< world units; positive

  /// Straight (not premultiplied) RGB and opacity per unit_distance, each in 0..1, at a value;
  /// constant beyond the first and last points.
  [[nodiscard]] glm::dvec4 operator()(double value) const;
};

/// Reads the first preset of a ParaView JSON file. Input is untrusted.
/// io: missing. bad_file: not JSON, missing or unsorted points, non-finite numbers, each with its
/// place. unsupported: a colour space that is not known.
[[nodiscard]] Result<TransferFunction> read_transfer(const std::string& path);
[[nodiscard]] Result<TransferFunction> parse_transfer(const std::string& json,
                                                      const std::string& source);

/// A sensible function for a volume that comes without one, from its histogram: what is
/// background (air) is clear, the rest rises to opaque from dark to bright.
/// For label volumes, a colour per label and label 0 clear.
[[nodiscard]] TransferFunction default_transfer(const Volume& volume);

/// The preset JSON of a function: parse_transfer gives the same function back.
[[nodiscard]] std::string to_json(const TransferFunction& transfer);

}  // namespace slf
