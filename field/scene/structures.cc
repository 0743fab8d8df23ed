#include "field/scene/structures.h"

#include <cmath>
#include <map>
#include <unordered_map>

#include "field/volume/transfer_color.h"
#include "field/volume/voxels.h"

namespace slf {
namespace {

constexpr std::size_t kMaxRows = 256;

/// usage: `other` does not lie on the grid of `volume`.
Result<void> check_grid(const char* what, const Volume& other, const Volume& volume) {
  const auto size = [](const Volume& v) {
    return std::to_string(v.dims[0]) + "x" + std::to_string(v.dims[1]) + "x" +
           std::to_string(v.dims[2]);
  };
  if (other.dims != volume.dims)
    return fail(ErrorCode::usage, other.source, ": ", what, " of ", size(other), " voxels, but ",
                volume.source, " has ", size(volume), "; both must be of one grid");
  const glm::dvec3 last(volume.dims[0] - 1, volume.dims[1] - 1, volume.dims[2] - 1);
  const glm::dvec3 spacing = volume.spacing();
  for (const glm::dvec3& corner : {glm::dvec3(0), last}) {
    const double apart =
        glm::distance(volume.origin + volume.axes * corner, other.origin + other.axes * corner);
    if (apart > 0.5 * std::min({spacing.x, spacing.y, spacing.z}))
      return fail(ErrorCode::usage, other.source, ": ", what, " lies ", apart, " units apart from ",
                  volume.source, "; both must be of one grid");
  }
  return {};
}

/// Adds a copy of the first row in another colour and with `factor` of its opacity.
void add_row(TransferTable& table, const std::optional<glm::dvec3>& color, double factor) {
  for (std::size_t k = 0; k < table.entries; ++k) {
    const double opacity = factor * opacity_of(table, table.extinctions[k]);
    table.colors.push_back(color ? glm::vec4(*color, 0) : table.colors[k]);
    table.extinctions.push_back(static_cast<float>(extinction_of(table, opacity)));
  }
}

}  // namespace

Result<void> add_structures(const Structures& structures, const Volume& volume, RayGrid& grid) {
  grid.rows.assign(volume.voxel_count(), 0);
  grid.visible_rows = {1};
  const auto add = [&](const std::optional<glm::dvec3>& color, double factor) {
    add_row(grid.table, color, factor);
    grid.visible_rows.push_back(factor > 0);
    return static_cast<std::uint8_t>(grid.visible_rows.size() - 1);
  };
  if (const Volume* labels = structures.labels.get()) {
    if (auto ok = check_grid("labels", *labels, volume); !ok) return ok;
    std::unordered_map<double, std::uint8_t> row_of;
    const bool fits = visit_voxels(*labels, [&](auto ids) {
      for (std::size_t k = 0; k < ids.size(); ++k) {
        const double id = labels->slope * static_cast<double>(ids[k]) + labels->intercept;
        auto found = row_of.find(id);
        if (found == row_of.end()) {
          if (grid.visible_rows.size() + 1 >= kMaxRows) return false;
          const auto style = structures.styles.find(static_cast<std::int64_t>(std::llround(id)));
          std::uint8_t row = 0;
          if (style != structures.styles.end())
            row = add(style->second.color, style->second.opacity);
          else if (id != 0)
            row = add(transfer_color::of_label(id), 1);
          found = row_of.emplace(id, row).first;
        }
        grid.rows[k] = found->second;
      }
      return true;
    });
    if (!fits)
      return fail(ErrorCode::unsupported, labels->source, ": more than ", kMaxRows - 2,
                  " different labels");
  }
  if (const Volume* mask = structures.mask.get()) {
    if (auto ok = check_grid("a mask", *mask, volume); !ok) return ok;
    const std::uint8_t hidden = add(std::nullopt, 0);
    visit_voxels(*mask, [&](auto inside) {
      for (std::size_t k = 0; k < inside.size(); ++k)
        if (!(mask->slope * static_cast<double>(inside[k]) + mask->intercept != 0))
          grid.rows[k] = hidden;
    });
  }
  return {};
}

}  // namespace slf
