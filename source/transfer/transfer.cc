#include "slf/transfer.h"

#include <algorithm>
#include <cmath>

#include "source/transfer/transfer_color.h"
#include "source/transfer/value_statistics.h"

namespace slf {

namespace {

/// The first point at or above a value, as in VTK. Of two points at one value, the first applies at
/// the value itself and the second above it.
template <class Point>
auto at_or_above(const std::vector<Point>& points, double value) {
  return std::lower_bound(points.begin(), points.end(), value,
                          [](const Point& point, double at) { return point.value < at; });
}

// vtkPiecewiseFunction's curve between two nodes: linear to the midpoint and from it on, then
// bent towards a step by the sharpness.
double interpolate(const TransferFunction::OpacityPoint& a, const TransferFunction::OpacityPoint& b,
                   double value) {
  const double y1 = a.opacity, y2 = b.opacity;
  const double midpoint = std::clamp(a.midpoint, 0.00001, 0.99999);
  double s = fraction(value, a.value, b.value);
  s = s < midpoint ? 0.5 * s / midpoint : 0.5 + 0.5 * (s - midpoint) / (1 - midpoint);
  if (a.sharpness > 0.99) return s < 0.5 ? y1 : y2;
  if (a.sharpness < 0.01) return (1 - s) * y1 + s * y2;

  const double exponent = 1 + 10 * a.sharpness;
  if (s < 0.5)
    s = 0.5 * std::pow(2 * s, exponent);
  else if (s > 0.5)
    s = 1 - 0.5 * std::pow(2 * (1 - s), exponent);
  const double ss = s * s, sss = ss * s;
  const double slope = (1 - a.sharpness) * (y2 - y1);
  const double y = (2 * sss - 3 * ss + 1) * y1 + (3 * ss - 2 * sss) * y2 +
                   (sss - 2 * ss + s) * slope + (sss - ss) * slope;
  return std::clamp(y, std::min(y1, y2), std::max(y1, y2));
}

}  // namespace

glm::dvec4 TransferFunction::operator()(double value) const {
  if (std::isnan(value)) return glm::dvec4(0.0);
  glm::dvec3 color;
  const auto c = at_or_above(colors, value);
  if (c == colors.begin())
    color = c->rgb;
  else if (c == colors.end())
    color = colors.back().rgb;
  else
    color = transfer_color::interpolate(space, (c - 1)->rgb, c->rgb,
                                        fraction(value, (c - 1)->value, c->value));
  const auto o = at_or_above(opacities, value);
  const double opacity = o == opacities.begin() ? o->opacity
                         : o == opacities.end() ? opacities.back().opacity
                                                : interpolate(*(o - 1), *o, value);
  return {glm::clamp(color, 0.0, 1.0), std::clamp(opacity, 0.0, 1.0)};
}

}  // namespace slf
