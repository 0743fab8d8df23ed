// TransferFunction: from a volume's value to colour and opacity.
//
// Values are in the volume's own units; opacity is per `unit_distance` world units and must be
// corrected for the step actually taken: 1 - (1 - opacity)^(step / unit_distance).
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

/// A transfer function before it meets a volume: a file or a name gives colours and perhaps
/// opacities, over values that may be relative.
struct TransferPreset {
  enum class Values : std::uint8_t {
    absolute,  ///< the volume's own units
    relative,  ///< the extent of the points stands for a range of the volume's
    indexed,   ///< categories: the ids of labels, else equal steps over a range
  };

  /// Complete in itself: where has_opacity is false, its opacities are a ramp over its extent.
  TransferFunction function;
  Values values = Values::absolute;
  bool has_opacity = true;        ///< false: a colour map
  bool has_unit_distance = true;  ///< false: opacity is per voxel, whatever its size
  std::string description{};      ///< of built-in presets: what they show

  /// The function for a volume.
  ///
  /// Values that are relative, and those that run exactly from 0 to 1 or from −1 to 1, are
  /// stretched to the volume's: from its 0.1 % to its 99.9 % quantile, symmetrically to 0 where its
  /// background is 0 amid both signs, by logarithm where it spans more than four decades. (A
  /// function with opacities keeps its 0 to 1 where the volume reaches at most twice as far.) A
  /// colour map gets the opacities of default_transfer(). Labels get a colour per id.
  ///
  /// `range`, in the volume's units and ascending, overrules all of this: the points are stretched
  /// to it, and a colour map's opacity rises from 0 at its start to 0.95 at its end.
  [[nodiscard]] TransferFunction fit(const Volume& volume,
                                     const std::optional<std::array<double, 2>>& range = {}) const;
};

/// The presets that come with the library: absolute ones for CT in Hounsfield units, others
/// relative. Static lifetime.
[[nodiscard]] std::span<const TransferPreset> built_in_transfers();

/// Reads a preset by reference: a built-in name as "ct-bone", a path, or "PATH#NAME" for one of
/// several in a file, in any case of letters. Without NAME it is the first. "./ct-bone" is a path.
///
/// Files, told apart by content: ParaView's preset JSON, an array of presets or one alone, with
/// RGBPoints or IndexedColors, with or without Points; 3D Slicer's volume properties (.vp and
/// .vp.json), whose gradient opacity and lighting are ignored; MRIcroGL's .clut, relative where its
/// min is its max. Input is untrusted.
/// io: missing. usage: no built-in and no file, no preset of that name; the message lists some.
/// bad_file: not such a file, missing or unsorted points, a count that is not 4 a point, channels
/// or opacities outside 0..1, each with its place, as `[0].Points[8]`.
/// unsupported: a colour space that is not known.
[[nodiscard]] Result<TransferPreset> read_transfer(const std::string& reference);

/// All presets of a file. Errors as read_transfer.
[[nodiscard]] Result<std::vector<TransferPreset>> read_transfers(const std::string& path);

/// The presets in the bytes of a file; `source` is its name for messages, and theirs where they
/// have none. Errors as read_transfer.
[[nodiscard]] Result<std::vector<TransferPreset>> parse_transfers(const std::string& bytes,
                                                                  const std::string& source);

/// The first preset of ParaView's JSON, which must be complete: what to_json() gives. RGBPoints and
/// Points are required; Name, ColorSpace (RGB) and ScalarOpacityUnitDistance (1) have defaults.
/// Errors as read_transfer.
[[nodiscard]] Result<TransferFunction> parse_transfer(const std::string& json,
                                                      const std::string& source);

/// A sensible function for a volume that comes without one. unit_distance is the size of a voxel.
///
/// From the histogram: the background (below Otsu's threshold) is clear, the rest rises to opaque
/// from dark to bright, with more points where there are more values. Where the brightest few
/// would hide that the rest parts again (PET), the lower threshold counts. Positive values that
/// span more than four decades are taken by their logarithms. Values of both signs around a
/// background of 0 (statistics, field maps) rise both ways, from blue to cyan and from red to
/// yellow, on one scale.
///
/// For labels: Space::step with a colour for each id there is, hues apart by the golden ratio of
/// the id, so that an id has one colour in every volume; 0 is clear and the others opaque. Only
/// look it up at ids: sample label volumes at the nearest voxel.
[[nodiscard]] TransferFunction default_transfer(const Volume& volume);

/// The preset JSON of a function: parse_transfer gives the same function back.
[[nodiscard]] std::string to_json(const TransferFunction& transfer);

}  // namespace slf
