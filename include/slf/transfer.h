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

#include "slf/error.h"

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
  std::vector<ColorPoint> colors;       ///< ascending in value (equal: a jump), at least one
  std::vector<OpacityPoint> opacities;  ///< ascending in value, at least one
  double unit_distance = 1;             ///< world units; positive

  /// Straight (not premultiplied) RGB and opacity per unit_distance, each in 0..1, at a value;
  /// constant beyond the first and last points, all 0 for NaN. As VTK evaluates it: in Space::step
  /// the stretch up to and with a point has that point's colour; of two points at one value the
  /// first holds at the value itself and the second beyond it, a jump.
  [[nodiscard]] glm::dvec4 operator()(double value) const;
};

/// Reads the first preset of a ParaView JSON file, an array of presets or one alone. Input is
/// untrusted. Keys: RGBPoints and Points are required; Name, ColorSpace (RGB) and
/// ScalarOpacityUnitDistance (1) have defaults; others are ignored.
/// io: missing. bad_file: not JSON, missing or unsorted points, a count that is not 4 a point,
/// channels or opacities outside 0..1, each with its place, as `[0].Points[8]`.
/// unsupported: a colour space that is not known.
[[nodiscard]] Result<TransferFunction> read_transfer(const std::string& path);
[[nodiscard]] Result<TransferFunction> parse_transfer(const std::string& json,
                                                      const std::string& source);

/// A sensible function for a volume that comes without one. unit_distance is the size of a voxel.
///
/// From the histogram: what lies below Otsu's threshold (air, background) is clear, the rest rises
/// to opaque from dark to bright, with more points where there are more values. Positive values
/// that span more than four decades are taken by their logarithms.
///
/// For labels: Space::step with a colour for each id there is, hues apart by the golden ratio of
/// the id, so that an id has one colour in every volume; 0 is clear and the others opaque. Only
/// look it up at ids: sample label volumes at the nearest voxel.
[[nodiscard]] TransferFunction default_transfer(const Volume& volume);

/// The preset JSON of a function: parse_transfer gives the same function back.
[[nodiscard]] std::string to_json(const TransferFunction& transfer);

}  // namespace slf
