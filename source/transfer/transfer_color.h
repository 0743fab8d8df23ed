// Colour interpolation like VTK's vtkColorTransferFunction, so that a preset looks the same as in
// ParaView.
#pragma once

#include <glm/glm.hpp>

#include "slf/transfer.h"

namespace slf::transfer_color {

/// Hue, saturation, value, each in 0..1, from RGB and back.
[[nodiscard]] glm::dvec3 rgb_to_hsv(const glm::dvec3& rgb);
[[nodiscard]] glm::dvec3 hsv_to_rgb(const glm::dvec3& hsv);

/// CIELAB of sRGB under D65, and back into the gamut.
[[nodiscard]] glm::dvec3 rgb_to_lab(const glm::dvec3& rgb);
[[nodiscard]] glm::dvec3 lab_to_rgb(const glm::dvec3& lab);

/// The colour at s in 0..1 between a and b. In Space::step it is always b.
[[nodiscard]] glm::dvec3 interpolate(TransferFunction::Space space, const glm::dvec3& a,
                                     const glm::dvec3& b, double s);

/// The default colour of a label. Hues are multiples of the golden ratio.
[[nodiscard]] glm::dvec3 of_label(double id);

}  // namespace slf::transfer_color
