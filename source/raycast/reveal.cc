#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>
#include <vector>

#include "base/parallel.h"
#include "base/try.h"
#include "slf/cut.h"
#include "source/raycast/prepared_volume.h"
#include "source/raycast/provenance.h"

namespace slf {
namespace {

/// The voxels of a volume that those of its reveal are made of, along one axis.
struct Samples {
  struct Mean {
    std::uint32_t first;         ///< voxel
    std::vector<float> weights;  ///< of it and those after it; their sum is 1
  };
  double begin = 0, step = 1;  ///< of the reveal's voxels, in those of the volume
  std::vector<Mean> means{};
  std::vector<std::uint32_t> nearest{};

  /// The reveal's voxels are `spacing` of the volume's apart, or a little less, but at least 1.
  Samples(double low, double high, double spacing, std::uint32_t voxels) : begin(low) {
    const double length = high - low;
    const auto count = static_cast<std::uint32_t>(
        std::max(1.0, std::ceil(length / std::max(spacing, 1.0) - 1e-9)));
    step = length / count;
    // Of Lanczos: means without negative weights blur thin bone, which then looks like holes.
    constexpr double kLobes = 3;
    const double scale = std::max(step, 1.0), reach = kLobes * scale;
    const auto sinc = [](double x) {
      x *= std::numbers::pi;
      return std::abs(x) < 1e-9 ? 1 : std::sin(x) / x;
    };
    for (std::uint32_t k = 0; k <= count; ++k) {
      const double at = low + k * step;
      const auto first = static_cast<std::uint32_t>(std::max(0.0, std::floor(at - reach) + 1));
      const auto last =
          static_cast<std::uint32_t>(std::min<double>(voxels - 1, std::ceil(at + reach) - 1));
      Mean mean{first, {}};
      const auto weight = [&](std::uint32_t v) {
        return sinc((v - at) / scale) * sinc((v - at) / reach);
      };
      double sum = 0;
      for (std::uint32_t v = first; v <= last; ++v) sum += weight(v);
      for (std::uint32_t v = first; v <= last; ++v)
        mean.weights.push_back(static_cast<float>(weight(v) / sum));
      means.push_back(std::move(mean));
      nearest.push_back(std::min(static_cast<std::uint32_t>(std::lround(at)), voxels - 1));
    }
  }
  [[nodiscard]] std::uint32_t size() const { return static_cast<std::uint32_t>(means.size()); }
};
using Grid = std::array<Samples, 3>;

/// Calls set(number, x, y, z) for the voxels of a reveal.
template <class Set>
Result<void> for_each_voxel(const Grid& grid, unsigned threads, const Set& set) {
  const std::uint32_t nx = grid[0].size(), ny = grid[1].size();
  return parallel_for(grid[2].size(), threads, [&](std::uint64_t z) {
    for (std::uint32_t y = 0; y < ny; ++y)
      for (std::uint32_t x = 0; x < nx; ++x) set((z * ny + y) * nx + x, x, y, z);
  });
}

/// The number of the volume's voxel that is nearest to one of the reveal.
std::size_t voxel_near(const Volume& volume, const Grid& grid, std::uint32_t x, std::uint32_t y,
                       std::uint64_t z) {
  const std::size_t row = std::size_t{grid[2].nearest[z]} * volume.dims[1] + grid[1].nearest[y];
  return row * volume.dims[0] + grid[0].nearest[x];
}

/// The means of a volume's amounts, as bytes of the reveal.
Result<void> resample(const PreparedVolume& scene, const Grid& grid, unsigned threads, Reveal& to) {
  const Samples &sx = grid[0], &sy = grid[1], &sz = grid[2];
  const std::size_t width = scene.volume.dims[0], rows = scene.volume.dims[1];
  const double scale = 255 / (to.high - to.low);
  return with_grid_type(scene.grid.type, [&]<class T>(T) {
    const auto* voxels = reinterpret_cast<const T*>(scene.grid.voxels);
    return parallel_for(sz.size(), threads, [&](std::uint64_t z) {
      // Slices, then rows of their mean, then voxels of the mean of these.
      const std::size_t x0 = sx.means.front().first, y0 = sy.means.front().first;
      const std::size_t x1 = sx.means.back().first + sx.means.back().weights.size();
      const std::size_t y1 = sy.means.back().first + sy.means.back().weights.size();
      std::vector<float> slice(width * rows), row(width);
      const Samples::Mean& slices = sz.means[z];
      for (std::size_t k = 0; k < slices.weights.size(); ++k)
        for (std::size_t y = y0; y < y1; ++y) {
          const T* const from = voxels + ((slices.first + k) * rows + y) * width;
          for (std::size_t x = x0; x < x1; ++x)
            slice[y * width + x] += slices.weights[k] * static_cast<float>(from[x]);
        }
      std::size_t number = z * sy.size() * sx.size();
      for (const Samples::Mean& mean : sy.means) {
        std::fill(row.begin(), row.end(), 0.f);
        for (std::size_t k = 0; k < mean.weights.size(); ++k)
          for (std::size_t x = x0; x < x1; ++x)
            row[x] += mean.weights[k] * slice[(mean.first + k) * width + x];
        for (const Samples::Mean& of : sx.means) {
          float sum = 0;
          for (std::size_t k = 0; k < of.weights.size(); ++k)
            sum += of.weights[k] * row[of.first + k];
          const double value = scene.volume.slope * sum + scene.volume.intercept;
          to.voxels[number++] =
              static_cast<std::byte>(std::lround(std::clamp((value - to.low) * scale, 0.0, 255.0)));
        }
      }
    });
  });
}

/// The values between which a transfer function changes, or is visible.
std::array<double, 2> shown_range(const TransferFunction& transfer,
                                  const std::array<double, 2>& all) {
  const auto& points = transfer.opacities;
  double low = all[0], high = std::max(points.back().value, transfer.colors.back().value);
  for (std::size_t k = 0; k < points.size() && points[k].opacity == 0; ++k) low = points[k].value;
  for (std::size_t k = points.size(); k-- > 0 && points[k].opacity == 0;) high = points[k].value;
  low = std::clamp(low, all[0], all[1]), high = std::clamp(high, all[0], all[1]);
  return low < high ? std::array{low, high} : all;
}

/// What any of some scenes shows of their volume: by byte of a reveal, and by structure.
struct Visible {
  std::array<bool, 256> bytes{}, parts{};

  void add_amounts(const PreparedVolume& scene, const Reveal& reveal) {
    const double width = (reveal.high - reveal.low) / 255;
    const auto entry = [&](double byte) {
      const double value = reveal.low + byte * width;
      const double stored = (value - scene.volume.intercept) / scene.volume.slope;
      return entry_of(scene.grid.table, static_cast<float>(stored));
    };
    for (std::size_t b = 0; b < bytes.size(); ++b) {
      const std::size_t below = entry(static_cast<double>(b) - 0.75);
      const std::size_t above =
          entry(static_cast<double>(b) + 0.75);  // lower under a negative slope
      for (std::size_t k = std::min(below, above); k <= std::max(below, above); ++k)
        bytes[b] = bytes[b] || scene.grid.table.extinctions[k] > 0;
    }
  }
};

/// Gives voxels that touch no visible cell the byte 0.
void leave_out_hidden(const Visible& visible, Reveal& reveal) {
  const std::size_t nx = reveal.dims[0], ny = reveal.dims[1], nz = reveal.dims[2];
  std::array<int, 257> before{};  // how many visible bytes are below one
  for (std::size_t b = 0; b < 256; ++b) before[b + 1] = before[b] + (visible.bytes[b] ? 1 : 0);
  std::vector<bool> kept(reveal.voxels.size());
  for (std::size_t z = 0; z + 1 < nz; ++z)
    for (std::size_t y = 0; y + 1 < ny; ++y)
      for (std::size_t x = 0; x + 1 < nx; ++x) {
        std::array<std::size_t, 8> corners{};
        std::uint8_t low = 255, high = 0;
        bool part = reveal.parts.empty();
        for (std::size_t k = 0; k < 8; ++k) {
          corners[k] = ((z + (k >> 2)) * ny + y + (k >> 1 & 1)) * nx + x + (k & 1);
          const auto value = std::to_integer<std::uint8_t>(reveal.voxels[corners[k]]);
          low = std::min(low, value), high = std::max(high, value);
          part = part || visible.parts[std::to_integer<std::size_t>(reveal.parts[corners[k]])];
        }
        if (!part || before[high + std::size_t{1}] == before[low]) continue;
        for (const std::size_t corner : corners) kept[corner] = true;
      }
  for (std::size_t k = 0; k < kept.size(); ++k)
    if (!kept[k]) reveal.voxels[k] = std::byte{0};
}

/// The structures of voxels, and which are visible. Those of other scenes have the same ids.
Result<void> copy_parts(std::span<const PreparedVolume* const> scenes, const Grid& grid,
                        unsigned threads, Visible& visible, Reveal& to) {
  const PreparedVolume& first = *scenes.front();
  to.part_ids = first.grid.parts->ids;
  to.masked = first.grid.visible_rows.size() > to.part_ids.size() + 1;
  for (const PreparedVolume* scene : scenes) {
    const std::vector<double>& ids = scene->grid.parts->ids;
    for (std::size_t part = 0; part <= to.part_ids.size(); ++part) {
      const auto found = std::ranges::find(ids, part == 0 ? 0.0 : to.part_ids[part - 1]);
      const auto row = found == ids.end() ? 0 : found - ids.begin() + 1;
      if (scene->grid.visible_rows[static_cast<std::size_t>(row)]) visible.parts[part] = true;
    }
  }
  to.parts.resize(to.voxels.size());
  return for_each_voxel(grid, threads, [&](std::size_t k, auto x, auto y, auto z) {
    to.parts[k] = std::byte{first.grid.rows[voxel_near(first.volume, grid, x, y, z)]};
  });
}

/// The ids of a volume of labels as bytes; all that are hidden, if they are to be left out, as one.
/// Returns the byte of a hidden one, if there is one.
Result<std::optional<std::uint8_t>> copy_labels(std::span<const PreparedVolume* const> scenes,
                                                const Grid& grid, bool all, unsigned threads,
                                                Reveal& to) {
  const PreparedVolume& first = *scenes.front();
  std::map<std::size_t, std::uint8_t> bytes;  // by number of the label
  std::optional<std::uint8_t> hidden;
  const auto stored = [&](std::uint32_t x, std::uint32_t y, std::uint64_t z) {
    const std::size_t voxel = voxel_near(first.volume, grid, x, y, z);
    return with_grid_type(first.grid.type, [&]<class T>(T) {
      return static_cast<std::size_t>(reinterpret_cast<const T*>(first.grid.voxels)[voxel]);
    });
  };
  bool fits = true;
  SLF_TRY(for_each_voxel(grid, 1, [&](std::size_t, auto x, auto y, auto z) {
    const std::size_t label = stored(x, y, z);
    if (bytes.contains(label) || !fits) return;
    const bool shown = std::ranges::any_of(scenes, [&](const PreparedVolume* scene) {
      return scene->grid.table.extinctions[label] > 0;
    });
    const auto next = static_cast<std::uint8_t>(to.ids.size());
    if (!shown && !all && hidden) {
      bytes[label] = *hidden;
      return;
    }
    if (!shown) hidden = next;
    bytes[label] = next;
    to.ids.push_back(first.volume.slope * first.labels[label] + first.volume.intercept);
    fits = to.ids.size() <= 256;
  }));
  if (!fits)
    return unsupported(first.volume.source, "more than 256 labels, which a reveal cannot hold");
  SLF_TRY(for_each_voxel(grid, threads, [&](std::size_t k, auto x, auto y, auto z) {
    to.voxels[k] = std::byte{bytes.at(stored(x, y, z))};
  }));
  return hidden;
}

/// Gives voxels the byte `blank` that planes remove from all of the scenes, but for those next to
/// the planes.
Result<void> leave_out_removed(std::span<const PreparedVolume* const> scenes, const Grid& grid,
                               std::uint8_t blank, unsigned threads, Reveal& reveal) {
  const auto whole = [](const PreparedVolume* scene) { return scene->grid.clip.empty(); };
  if (std::ranges::any_of(scenes, whole)) return {};
  const double margin = 1 + std::max({grid[0].step, grid[1].step, grid[2].step});
  return for_each_voxel(grid, threads, [&](std::size_t k, auto x, auto y, auto z) {
    const glm::dvec3 at(grid[0].begin + x * grid[0].step, grid[1].begin + y * grid[1].step,
                        grid[2].begin + static_cast<double>(z) * grid[2].step);
    const auto keeps = [&](const PreparedVolume* scene) {
      return std::ranges::all_of(
          scene->grid.clip, [&](const GridPlane& plane) { return plane.inside(at) > -margin; });
    };
    if (std::ranges::none_of(scenes, keeps)) reveal.voxels[k] = std::byte{blank};
  });
}

}  // namespace

Result<Reveal> make_reveal(std::span<const Scene* const> scenes, const RevealOptions& options) try {
  std::vector<const PreparedVolume*> of;
  Reveal reveal;
  for (const Scene* scene : scenes) {
    const auto* const caster = dynamic_cast<const Raycaster*>(scene);
    const std::string content = caster ? content_of(caster->provenance()) : "";
    if (of.empty() && !caster)
      return fail_without("reveal", ErrorCode::usage,
                          "only volumes that are ray-cast have a reveal, of which cuts show the "
                          "inside");
    if (of.empty()) reveal.content = content;
    if (caster && content == reveal.content) of.push_back(&caster->prepared());
  }
  if (of.empty()) return fail(ErrorCode::usage, "a reveal needs a scene");
  if (options.side < 16 || options.side > Reveal::kMaxSide)
    return fail_without("reveal", ErrorCode::usage, "reveal ", options.side, ": expected 16 to ",
                        Reveal::kMaxSide, " voxels");
  if (options.window && !((*options.window)[0] < (*options.window)[1]))
    return fail_without("reveal_window", ErrorCode::usage, "reveal window ", (*options.window)[0],
                        ",", (*options.window)[1], ": expected two ascending numbers");
  const PreparedVolume& first = *of.front();
  const Volume& volume = first.volume;
  // The visible box, with a voxel around it.
  glm::dvec3 low(first.grid.visible_low), high(first.grid.visible_high);
  for (const PreparedVolume* scene : of) {
    low = glm::min(low, scene->grid.visible_low);
    high = glm::max(high, scene->grid.visible_high);
  }
  const glm::dvec3 spacing = volume.spacing();
  const glm::dvec3 end(volume.dims[0] - 1, volume.dims[1] - 1, volume.dims[2] - 1);
  low = glm::max(glm::floor(low) - 1.0, 0.0), high = glm::min(glm::ceil(high) + 1.0, end);
  const glm::dvec3 size = (high - low) * spacing;
  const double apart = std::max({size.x, size.y, size.z}) / (options.side - 1);
  const auto along = [&](int axis) {
    return Samples(low[axis], high[axis], apart / spacing[axis], volume.dims[axis]);
  };
  const Grid grid{along(0), along(1), along(2)};
  for (int axis = 0; axis < 3; ++axis) {
    reveal.dims[static_cast<std::size_t>(axis)] = grid[static_cast<std::size_t>(axis)].size();
    reveal.axes[axis] = volume.axes[axis] * grid[static_cast<std::size_t>(axis)].step;
  }
  reveal.origin = volume.origin + volume.axes * low;
  reveal.unit = first.grid.unit;
  reveal.voxels.resize(std::size_t{reveal.dims[0]} * reveal.dims[1] * reveal.dims[2]);
  if (volume.labels) {
    const auto hidden =
        SLF_TRY(copy_labels(of, grid, options.window.has_value(), options.threads, reveal));
    if (hidden) SLF_TRY(leave_out_removed(of, grid, *hidden, options.threads, reveal));
    return reveal;
  }
  reveal.loss = options.loss;
  Visible visible;
  if (!first.grid.rows.empty()) SLF_TRY(copy_parts(of, grid, options.threads, visible, reveal));
  reveal.gradient =
      std::abs(volume.slope) / (double{first.grid.inverse_gradient_floor} * first.grid.unit);
  const auto all = volume.value_range();
  reveal.greys = {all[1], all[0]};
  for (const PreparedVolume* scene : of) {
    const auto transfer = SLF_TRY(parse_transfer(
        nlohmann::json::parse(scene->provenance).at("transfer").dump(), volume.source));
    const auto range = shown_range(transfer, all);
    reveal.greys = {std::min(reveal.greys[0], range[0]), std::max(reveal.greys[1], range[1])};
  }
  if (options.window) reveal.greys = *options.window;
  if (!(reveal.greys[0] < reveal.greys[1])) reveal.greys[1] = reveal.greys[0] + 1;
  // What is interpolated needs values beyond those that are visible, too.
  const double beyond = options.window ? 0 : reveal.greys[1] - reveal.greys[0];
  reveal.low = options.window ? reveal.greys[0] : std::max(all[0], reveal.greys[0] - beyond);
  reveal.high = options.window
                    ? reveal.greys[1]
                    : std::max(std::min(all[1], reveal.greys[1] + beyond), reveal.greys[1]);
  SLF_TRY(resample(first, grid, options.threads, reveal));
  if (options.window) {  // all but what a mask hides
    visible.bytes.fill(true), visible.parts.fill(true);
    if (reveal.masked) visible.parts[reveal.part_ids.size() + 1] = false;
  }
  for (const PreparedVolume* scene : of) visible.add_amounts(*scene, reveal);
  leave_out_hidden(visible, reveal);
  SLF_TRY(leave_out_removed(of, grid, 0, options.threads, reveal));
  return reveal;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
