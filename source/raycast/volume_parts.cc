// The parts of a volume as rows of its table.
#include "source/raycast/prepared_volume.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <unordered_map>

#include "base/join.h"
#include "base/try.h"
#include "source/transfer/transfer_color.h"
#include "source/volume/voxels.h"

namespace slf {
namespace {

constexpr std::size_t kMaxRows = 256;

/// The box around a volume's voxel centres, as "-20,2,-10 to 8.5,32,23".
std::string extent_of(const Volume& volume) {
  glm::dvec3 low(std::numeric_limits<double>::infinity()), high = -low;
  for (int corner = 0; corner < 8; ++corner) {
    glm::dvec3 index;
    for (int axis = 0; axis < 3; ++axis)
      index[axis] = corner >> axis & 1 ? volume.dims[static_cast<std::size_t>(axis)] - 1 : 0;
    const glm::dvec3 at = volume.origin + volume.axes * index;
    low = glm::min(low, at);
    high = glm::max(high, at);
  }
  return concat(low.x, ",", low.y, ",", low.z, " to ", high.x, ",", high.y, ",", high.z);
}

/// Finds the voxel of one volume at each voxel of another: the nearest by world position.
class NearestVoxel {
 public:
  NearestVoxel(const Volume& of, const Volume& grid) : dims_(of.dims) {
    if (same_grid(of, grid)) return;  // exactly, whatever the origins were rounded to
    const glm::dmat3 to_index = glm::inverse(of.axes);
    origin_ = to_index * (grid.origin - of.origin);
    axes_ = to_index * grid.axes;
  }

  /// The index of the voxel at voxel (x,y,z) of the grid, or nothing outside the volume.
  [[nodiscard]] std::optional<std::size_t> operator()(std::uint32_t x, std::uint32_t y,
                                                      std::uint32_t z) const {
    // Rounding errors must decide neither ties nor what lies on the outer faces.
    constexpr double kTolerance = 1e-6;
    const glm::dvec3 at = origin_ + axes_ * glm::dvec3(x, y, z) + 0.5;
    std::size_t index = 0;
    for (int axis = 2; axis >= 0; --axis) {
      const std::size_t size = dims_[static_cast<std::size_t>(axis)];
      if (!(at[axis] >= -kTolerance && at[axis] <= static_cast<double>(size) + kTolerance))
        return std::nullopt;
      const auto nearest = static_cast<std::size_t>(std::max(at[axis] + kTolerance, 0.0));
      index = index * size + std::min(nearest, size - 1);
    }
    return index;
  }

 private:
  std::array<std::uint32_t, 3> dims_;
  glm::dvec3 origin_{0.0};
  glm::dmat3 axes_{1.0};
};

/// Calls visit(voxel of `grid`, voxel of `other` or nothing) until it returns false. usage: `other`
/// lies outside the grid.
template <class Visit>
Result<void> visit_nearest(const char* what, const Volume& other, const Volume& grid,
                           const Visit& visit) {
  const NearestVoxel nearest(other, grid);
  bool overlap = false;
  std::size_t voxel = 0;
  for (std::uint32_t z = 0; z < grid.dims[2]; ++z)
    for (std::uint32_t y = 0; y < grid.dims[1]; ++y)
      for (std::uint32_t x = 0; x < grid.dims[0]; ++x) {
        const auto found = nearest(x, y, z);
        overlap = overlap || found;
        if (!visit(voxel++, found)) return {};
      }
  if (overlap) return {};
  return misuse(other.source, what, " lies at ", extent_of(other), ", wholly outside of ",
                grid.source, " at ", extent_of(grid),
                ": do both state their positions in the same space?");
}

/// Adds a copy of the first row in another colour and with `factor` of its opacity.
void add_row(TransferTable& table, const std::optional<glm::dvec3>& color, double factor) {
  for (std::size_t k = 0; k < table.entries; ++k) {
    const double opacity = factor * opacity_of(table, table.extinctions[k]);
    table.colors.push_back(color ? glm::vec4(*color, 0) : table.colors[k]);
    table.extinctions.push_back(static_cast<float>(extinction_of(table, opacity)));
  }
}

/// `zero_is_part`: whether the id 0 has a row of its own.
Result<std::shared_ptr<const PartRows>> find_rows(const VolumeParts& parts, const Volume& volume,
                                                  bool zero_is_part) {
  PartRows found;
  found.rows.assign(volume.voxel_count(), 0);
  if (const Volume* labels = parts.labels.get()) {
    std::unordered_map<double, std::uint8_t> row_of;
    if (!zero_is_part) row_of[0] = 0;
    bool fits = true;
    SLF_TRY(visit_voxels(*labels, [&](auto ids) {
      return visit_nearest("a label volume", *labels, volume, [&](auto voxel, auto at) {
        const double id =
            at ? labels->slope * static_cast<double>(ids[*at]) + labels->intercept : 0.0;
        const auto [row, added] =
            row_of.try_emplace(id, static_cast<std::uint8_t>(found.ids.size() + 1));
        fits = !added || found.ids.size() + 2 < kMaxRows;
        if (added) found.ids.push_back(id);
        found.rows[voxel] = row->second;
        return fits;
      });
    }));
    if (!fits) return unsupported(labels->source, "more than ", kMaxRows - 2, " different labels");
  }
  if (const Volume* mask = parts.mask.get()) {
    const auto hidden = static_cast<std::uint8_t>(found.ids.size() + 1);
    SLF_TRY(visit_voxels(*mask, [&](auto inside) {
      return visit_nearest("a mask", *mask, volume, [&](auto voxel, auto at) {
        const double value =
            at ? mask->slope * static_cast<double>(inside[*at]) + mask->intercept : 0.0;
        if (!(value != 0)) found.rows[voxel] = hidden;
        return true;
      });
    }));
  }
  return std::make_shared<const PartRows>(std::move(found));
}

}  // namespace

bool same_grid(const Volume& a, const Volume& b) {
  if (a.dims != b.dims) return false;
  const glm::dvec3 spacing = b.spacing();
  const double tolerance = 0.5 * std::min({spacing.x, spacing.y, spacing.z});
  const glm::dvec3 last(b.dims[0] - 1, b.dims[1] - 1, b.dims[2] - 1);
  // Both maps are affine, so the first voxel and the ends of its three edges tell all.
  for (int corner = 0; corner < 4; ++corner) {
    glm::dvec3 index(0);
    if (corner < 3) index[corner] = last[corner];
    const double apart = glm::distance(a.origin + a.axes * index, b.origin + b.axes * index);
    if (!(apart <= tolerance)) return false;
  }
  return true;
}

Result<void> add_parts(const VolumeParts& parts, const Volume& volume, const std::string& content,
                       SharedScenes* shared, RayGrid& grid) {
  const bool hidden_rest = !parts.only.empty() && !parts.only.contains(0);
  const bool zero_is_part = hidden_rest || parts.styles.contains(0);
  std::shared_ptr<const PartRows> own;
  auto& found = shared ? shared->rows[concat(content, zero_is_part)] : own;
  if (!found) found = SLF_TRY(find_rows(parts, volume, zero_is_part));
  grid.parts = found;
  grid.rows = found->rows;
  grid.visible_rows = {1};
  const auto add = [&](const std::optional<glm::dvec3>& color, double factor) {
    add_row(grid.table, color, factor);
    grid.visible_rows.push_back(factor > 0);
  };
  for (const double id : found->ids) {
    const auto style = parts.styles.find(static_cast<std::int64_t>(std::llround(id)));
    if (!parts.only.empty() && !parts.only.contains(std::llround(id)))
      add(std::nullopt, 0);
    else if (style != parts.styles.end())
      add(style->second.color, style->second.opacity);
    else
      add(transfer_color::of_label(id), 1);
  }
  if (parts.mask) add(std::nullopt, 0);
  return {};
}

}  // namespace slf
