#include "source/raycast/prepared_volume.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <unordered_map>

#include "base/try.h"
#include "source/light/illumination.h"
#include "source/medium/transfer_table.h"
#include "source/medium/visible_space.h"
#include "source/raycast/provenance.h"
#include "source/volume/voxels.h"

namespace slf {
namespace {

void own(Volume& volume, std::vector<std::byte> voxels) {
  volume.voxels = std::move(voxels);
  volume.borrowed.reset();
}

/// Stores differences from the least value if the values differ little for their size.
void convert_to_float(Volume& volume) {
  const auto [low, high] = volume.value_range();
  const bool is_far = std::abs(low) > 16 * (high - low);
  const double base = is_far ? (low - volume.intercept) / volume.slope : 0;
  volume.intercept += volume.slope * base;
  visit_voxels(volume, [&](auto from) {
    std::vector<std::byte> converted(from.size() * sizeof(float));
    auto* to = reinterpret_cast<float*>(converted.data());
    for (std::size_t k = 0; k < from.size(); ++k)
      to[k] = static_cast<float>(static_cast<double>(from[k]) - base);
    own(volume, std::move(converted));
  });
  volume.type = ScalarType::f32;
}

/// Gives each label of a volume of another type a 16-bit number; returns label by number.
Result<std::vector<double>> renumber_labels(Volume& volume) {
  std::vector<double> labels;
  const bool fits = visit_voxels(volume, [&](auto from) {
    std::unordered_map<double, std::uint16_t> numbers;
    std::vector<std::byte> converted(from.size() * sizeof(std::uint16_t));
    auto* to = reinterpret_cast<std::uint16_t*>(converted.data());
    for (std::size_t k = 0; k < from.size(); ++k) {
      const auto label = static_cast<double>(from[k]);
      const auto [it, added] =
          numbers.try_emplace(label, static_cast<std::uint16_t>(numbers.size()));
      if (added && labels.size() == 65536) return false;
      if (added) labels.push_back(label);
      to[k] = it->second;
    }
    own(volume, std::move(converted));
    return true;
  });
  if (!fits)
    return unsupported(volume.source, "more than 65536 different labels; is this a label volume?");
  volume.type = ScalarType::u16;
  return labels;
}

std::array<float, 2> stored_range(const Volume& volume) {
  return visit_voxels(volume, [](auto voxels) {
    float low = std::numeric_limits<float>::max();
    float high = std::numeric_limits<float>::lowest();
    for (const auto voxel : voxels) {
      const auto value = static_cast<float>(voxel);
      if (!std::isfinite(value)) continue;
      low = std::min(low, value);
      high = std::max(high, value);
    }
    return low <= high ? std::array{low, high} : std::array{0.f, 0.f};
  });
}

/// Replaces NaN and infinities, which cannot be interpolated.
void replace_nonfinite(Volume& volume, float with) {
  if (volume.type != ScalarType::f32) return;
  if (volume.borrowed) {  // rarely needed, so it is worth looking before copying
    const std::span from(reinterpret_cast<const float*>(volume.borrowed.get()),
                         volume.voxel_count());
    if (std::ranges::all_of(from, [](float v) { return std::isfinite(v); })) return;
    own(volume, {volume.bytes().begin(), volume.bytes().end()});
  }
  auto* voxels = reinterpret_cast<float*>(volume.voxels.data());
  std::replace_if(
      voxels, voxels + volume.voxel_count(), [](float v) { return !std::isfinite(v); }, with);
}

/// The difference of stored values to which gradients are compared: that of the range. A few peaks
/// may lie far above all else; so at most 8 times the difference over which opacity rises to half.
float contrast_of(const TransferFunction& transfer, const Volume& volume,
                  const std::array<float, 2>& range) {
  const float whole = std::max(range[1] - range[0], 1e-30f);
  double max_opacity = 0;
  for (const auto& point : transfer.opacities) max_opacity = std::max(max_opacity, point.opacity);
  const auto risen =
      std::find_if(transfer.opacities.begin(), transfer.opacities.end(),
                   [&](const auto& point) { return point.opacity >= max_opacity / 2; });
  if (risen == transfer.opacities.end()) return whole;
  const double rise = std::abs((risen->value - volume.intercept) / volume.slope - range[0]);
  return rise > 1e-30 ? static_cast<float>(std::min(8 * rise, double{whole})) : whole;
}

/// Converts the voxels, and makes them `borrowed`.
Result<RayVoxels> ray_voxels(Volume& volume) {
  RayVoxels made;
  if (!volume.labels) {
    if (bytes_per_voxel(volume.type) > 2 && volume.type != ScalarType::f32)
      convert_to_float(volume);
    made.range = stored_range(volume);
    made.finite = has_finite_value(volume);
    replace_nonfinite(volume, made.range[0]);
  } else if (volume.type == ScalarType::u8 || volume.type == ScalarType::u16) {
    made.labels.resize(1 + static_cast<std::size_t>(stored_range(volume)[1]));
    std::iota(made.labels.begin(), made.labels.end(), 0);
  } else {
    made.labels = SLF_TRY(renumber_labels(volume));
  }
  volume.share();
  made.bytes = volume.borrowed;
  made.type = volume.type;
  made.intercept = volume.intercept;
  return made;
}

Result<void> check_options(const RaycastOptions& options) {
  if (!(options.step > 0.01 && options.step <= 100))
    return fail(ErrorCode::usage, "step ", options.step, ": expected 0.01 to 100 voxels");
  const double light = glm::length(options.light);
  if (!(light > 0) || !std::isfinite(light))
    return fail(ErrorCode::usage, "light: expected a direction, not zero and finite");
  if (!(options.ambient >= 0 && options.ambient <= 1))
    return fail(ErrorCode::usage, "ambient ", options.ambient, ": expected 0 to 1");
  for (const ClipPlane& plane : options.clip)
    if (const double sum = glm::length(plane.normal) + glm::length(plane.point);
        !std::isfinite(sum) || !(glm::length(plane.normal) > 0))
      return fail(ErrorCode::usage, "clip: expected a point and a normal, not zero and finite");
  if (options.projection != Projection::none &&
      (options.shade || options.lighting.mode != Lighting::direct))
    return fail(ErrorCode::usage, "a projection shows values, to which light does not apply");
  return options.lighting.mode == Lighting::direct ? Result<void>() : check_light(options.lighting);
}

}  // namespace

std::shared_ptr<SharedScenes> share_scenes() { return std::make_shared<SharedScenes>(); }

Result<std::unique_ptr<PreparedVolume>> prepare_volume(Volume volume,
                                                       const TransferFunction& transfer,
                                                       const RaycastOptions& options,
                                                       unsigned threads) {
  SLF_TRY(check_options(options));
  auto scene = std::make_unique<PreparedVolume>();
  scene->lighting = options.lighting;
  scene->provenance = describe(volume, transfer, options);
  scene->volume = std::move(volume);
  Volume& v = scene->volume;
  RayGrid& grid = scene->grid;

  const glm::dvec3 spacing = v.spacing();
  const double min_spacing = std::min({spacing.x, spacing.y, spacing.z});
  grid.unit = min_spacing;
  grid.step = options.step;

  if (v.labels && options.projection != Projection::none)
    return misuse(v.source, "a projection needs amounts, but this volume holds labels");
  grid.projection = options.projection;
  grid.labels = v.labels;
  const auto told = nlohmann::json::parse(scene->provenance);
  const auto content = told["content"].get<std::string>();
  RayVoxels own;
  RayVoxels& voxels = options.shared ? options.shared->voxels[content] : own;
  if (!voxels.bytes) voxels = SLF_TRY(ray_voxels(v));
  v.voxels.clear();
  v.borrowed = voxels.bytes;
  v.type = voxels.type;
  v.intercept = voxels.intercept;
  float contrast = 1;
  if (v.labels) {
    const auto& only = options.parts.only;
    scene->labels = voxels.labels;
    grid.table = make_label_table(transfer, v, voxels.labels);
    for (std::size_t k = 0; k < voxels.labels.size() && !only.empty(); ++k)
      if (!only.contains(std::llround(v.slope * voxels.labels[k] + v.intercept)))
        grid.table.extinctions[k] = 0;
  } else {
    grid.table = make_table(transfer, v, voxels.range);
    contrast = contrast_of(transfer, v, voxels.range);
  }

  if (!options.parts.only.empty() && !v.labels && !options.parts.labels)
    return misuse(v.source, "has no labels, of which only some could be shown");
  if (options.parts.labels || options.parts.mask) {
    if (v.labels)
      return misuse(v.source,
                    "structures are parts of a volume of amounts, but this one holds labels");
    const auto& said = told["structures"];
    SLF_TRY(add_parts(options.parts, v,
                      content + said.value("labels", " ") + said.value("mask", " "),
                      options.shared.get(), grid));
    for (const auto& part : {options.parts.labels, options.parts.mask})
      if (part) v.files.insert(v.files.end(), part->files.begin(), part->files.end());
  }
  integrate(grid.table);
  if (options.lighting.mode != Lighting::direct)
    for (glm::vec4& color : grid.table.colors)
      for (int c = 0; c < 3; ++c) color[c] = linear_from_srgb(color[c]);

  grid.voxels = v.bytes().data();
  grid.type = v.type;
  for (int axis = 0; axis < 3; ++axis) {
    grid.dims[axis] = static_cast<std::int32_t>(v.dims[axis]);
    if (grid.dims[axis] < 2)
      return unsupported(v.source, "a volume needs at least 2 voxels along ", "xyz"[axis],
                         ", found ", v.dims[axis]);
    grid.cells[axis] = grid.dims[axis] - 1;
  }
  grid.cell_shift = v.labels || !grid.rows.empty() ? 1 : 0;
  for (std::int32_t& cells : grid.cells) cells <<= grid.cell_shift;
  grid.world_to_index = glm::inverse(v.axes);
  grid.origin = v.origin;
  // Values rise where the stored ones do only under a positive slope.
  const double sign = v.slope < 0 && !v.labels ? -1 : 1;
  const glm::mat3 gradient_to_world(sign * min_spacing * glm::transpose(grid.world_to_index));
  for (int axis = 0; axis < 3; ++axis) {
    const auto k = static_cast<std::size_t>(axis);
    grid.gradient_to_world[k] = {gradient_to_world[axis], 0};
    grid.index_to_world[k] = glm::vec4(v.axes[axis], 0);
    grid.face_normals[k] = glm::vec4(glm::normalize(glm::transpose(grid.world_to_index)[axis]), 0);
  }
  for (const ClipPlane& plane : options.clip) {
    const glm::dvec3 normal = glm::normalize(plane.normal);
    const glm::dvec3 inwards = -glm::transpose(v.axes) * normal;
    const double per_voxel = glm::length(inwards);  // world units
    grid.clip.push_back({inwards / per_voxel, glm::dot(normal, plane.point - v.origin) / per_voxel,
                         glm::vec4(normal, 0)});
  }
  grid.inverse_gradient_floor = 1 / (0.02f * contrast);
  if (options.surface_gradient > 0)
    grid.inverse_gradient_floor =
        static_cast<float>(std::abs(v.slope) / (options.surface_gradient * min_spacing));
  grid.shade = options.shade;
  grid.light = {glm::vec3(glm::normalize(options.light)), 0};
  grid.ambient = options.ambient;

  const std::optional<Sphere> bounds = find_visible_space(v, grid, options.may_be_empty, threads);
  if (!bounds && !voxels.finite)
    return bad_file(v.source,
                    "all values are NaN or infinite: nothing is visible under any transfer "
                    "function; write the volume again");
  if (!bounds && !options.parts.only.empty())
    return fail_without("only_labels", ErrorCode::failed, v.source,
                        ": no visible voxel has one of the labels to show");
  if (!bounds && !grid.clip.empty())
    return fail_without("clip", ErrorCode::failed, v.source,
                        ": nothing visible is left by the planes that clip it");
  if (!bounds && options.parts.mask)
    return fail_without("mask", ErrorCode::failed, v.source,
                        ": nothing visible is left by the mask ", options.parts.mask->source);
  if (!bounds)
    return fail(ErrorCode::failed, v.source, ": the transfer function '", transfer.name,
                "' leaves nothing visible: its opacity is zero over all values of the volume (",
                v.value_range()[0], " to ", v.value_range()[1], ")");
  scene->bounds = *bounds;
  return scene;
}

}  // namespace slf
