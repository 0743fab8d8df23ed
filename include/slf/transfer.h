// TransferFunction: from a volume's value to colour and opacity.
//
// Values are in the volume's own units. Opacity is per `unit_distance` world units; over a distance
// d it is 1 - (1 - opacity)^(d / unit_distance).
//
//   auto preset = slf::read_transfer("ct-bone");  // or "maps.json#Viridis", "a.vp", "b.clut"
//   auto transfer = preset->fit(volume);
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slf/error.h"

namespace slf {

struct Volume;

class TransferFunction {
 public:
  /// Colour at a value. Between two points it is interpolated in `space`.
  struct ColorPoint {
    double value;
    glm::dvec3 rgb;
  };
  /// Opacity at a value, 0 to 1; midpoint and sharpness (ParaView) shape the curve to the next
  /// point.
  struct OpacityPoint {
    double value, opacity, midpoint, sharpness;
  };
  enum class Space { rgb, hsv, lab, diverging, step };

  std::string name;
  Space space = Space::rgb;
  std::vector<ColorPoint> colors;       ///< ascending in value (equal: a jump), at least one
  std::vector<OpacityPoint> opacities;  ///< ascending in value, at least one
  double unit_distance = 1;             ///< world units; positive

  /// Straight (not premultiplied) RGB and opacity per unit_distance, each in 0..1, at a value.
  /// Constant beyond the first and last points; all 0 for NaN. Evaluates as VTK does: in
  /// Space::step, values up to and including a point have that point's colour. Of two points at
  /// one value, the first holds at the value itself and the second above it.
  [[nodiscard]] glm::dvec4 operator()(double value) const;
};

/// A transfer function that is not fitted to a volume yet, as read from a file or built in. It has
/// colours and perhaps opacities, and its values may be relative.
struct TransferPreset {
  enum class Values : std::uint8_t {
    absolute,  ///< the volume's own units
    relative,  ///< the range from first to last point stands for a range of the volume's values
    indexed,   ///< categories: the ids of labels, else equal steps over a range
  };

  /// Usable on its own: if has_opacity is false, its opacities are a ramp over the range of points.
  TransferFunction function;
  Values values = Values::absolute;
  bool has_opacity = true;        ///< false: a colour map
  bool has_unit_distance = true;  ///< false: opacity is per voxel, whatever its size
  std::string description{};      ///< built-in presets: what they show

  /// The function for a volume.
  ///
  /// Relative points are stretched to the volume's values: from the 0.1 % to the 99.9 % quantile;
  /// symmetrically around 0 if values of both signs surround a background of 0; evenly in the
  /// logarithm if positive values span more than four decades. Absolute points that run exactly
  /// from 0 to 1, or from −1 to 1, count as relative, except if the function has opacities and the
  /// volume's values exceed this range by no more than its length. A colour map gets the opacities
  /// of default_transfer(). For labels, a colour map gives one colour per id.
  ///
  /// If `range` is given, in the volume's units and ascending, points are stretched to it instead,
  /// and a colour map's opacity rises from 0 at its start to 0.95 at its end. Labels ignore it.
  [[nodiscard]] TransferFunction fit(const Volume& volume,
                                     const std::optional<std::array<double, 2>>& range = {}) const;
};

/// The presets that come with the library: absolute ones for CT in Hounsfield units, others
/// relative. Static lifetime.
[[nodiscard]] std::span<const TransferPreset> built_in_transfers();

/// Reads a preset by reference: a built-in name such as "ct-bone", a path, or "PATH#NAME" for one
/// of several in a file. Names ignore case. Without NAME it is the first. "./ct-bone" is a path.
///
/// Files are recognised by content:
///  - ParaView's preset JSON, an array of presets or one alone, with RGBPoints or IndexedColors,
///    with or without Points;
///  - ParaView's colour maps in XML, one or more; as there, opacities of points are ignored;
///  - 3D Slicer's volume properties (.vp, .vp.json, presets.xml and scenes); gradient opacity and
///    lighting are ignored;
///  - MRIcroGL's .clut; relative if its min equals its max.
///
/// Input is untrusted.
/// io: the file cannot be read. usage: neither a built-in name nor a file, or the file has no
/// preset of that name; the message lists some. bad_file: another kind of file, missing or unsorted
/// points, a count of numbers that is not 4 per point, channels or opacities outside 0..1; the
/// message names the place, as in `[0].Points[8]`. unsupported: an unknown colour space.
[[nodiscard]] Result<TransferPreset> read_transfer(const std::string& reference);

/// The file that read_transfer() reads for this reference; empty if the name is built in.
[[nodiscard]] std::string transfer_file(const std::string& reference);

/// All presets of a file. Errors as read_transfer.
[[nodiscard]] Result<std::vector<TransferPreset>> read_transfers(const std::string& path);

/// The presets in the bytes of a file. `source` is the file's path, for messages and as a name of
/// presets that have none. Errors as read_transfer.
[[nodiscard]] Result<std::vector<TransferPreset>> parse_transfers(const std::string& bytes,
                                                                  const std::string& source);

/// The first preset of ParaView's JSON, in the form that to_json() writes. RGBPoints and Points are
/// required; Name, ColorSpace (RGB) and ScalarOpacityUnitDistance (1) have defaults. Errors as
/// read_transfer.
[[nodiscard]] Result<TransferFunction> parse_transfer(const std::string& json,
                                                      const std::string& source);

/// A sensible function for a volume that comes without one. unit_distance is the size of a voxel.
///
/// It is fitted to the histogram. The background, below Otsu's threshold, is clear. Above it,
/// opacity and brightness rise, with more points where values are frequent. If at most 5 % of the
/// values lie above the threshold and those below it fall into two clear classes (PET), the lower
/// threshold between these is used. Positive values that span more than four decades are treated
/// by their logarithms. For values of both signs around a background of 0 (statistics, field maps),
/// opacity rises with the magnitude: negative values from blue to cyan, positive ones from red to
/// yellow.
///
/// For labels: Space::step with a colour for each id in the volume. Hues are multiples of the
/// golden ratio, so an id has the same colour in every volume; 0 is clear and the others opaque.
/// Evaluate it at ids only: sample label volumes at the nearest voxel.
[[nodiscard]] TransferFunction default_transfer(const Volume& volume);

/// The preset JSON of a function: parse_transfer gives the same function back.
[[nodiscard]] std::string to_json(const TransferFunction& transfer);

/// What a ray shows, if not matter that absorbs and scatters light.
enum class Projection : std::uint8_t {
  none,
  maximum,  ///< the greatest value along the ray (MIP), in the transfer function's colour and
            ///< opacity of a unit; depth is where it was found
  minimum,  ///< the least one
  mean,     ///< the mean
};

}  // namespace slf
