// Drawings of measurements, as SVG.
#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "field/geometry/section.h"
#include "field/manifest.h"
#include "slf/camera.h"

namespace slf::cli {

/// The sphere from the camera's side, twice: the sections that `tiles` are entered through on its
/// front, and those they are exited through on its back; the darker, the more tiles.
[[nodiscard]] std::string draw_sections(const FieldShape& shape, const Camera& camera,
                                        unsigned level, std::span<const TileKey> tiles);

struct Series {
  std::string name;
  std::vector<std::pair<double, double>> points;  ///< y above 0
};

/// A plot with whole numbers along x and a logarithmic y.
[[nodiscard]] std::string draw_plot(const std::string& title, const std::string& x_label,
                                    const std::string& y_label, const std::vector<Series>& series);

}  // namespace slf::cli
