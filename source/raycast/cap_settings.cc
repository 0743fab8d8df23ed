#include "source/raycast/cap_settings.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/try.h"

namespace slf {
namespace {

using nlohmann::json;

/// The volume of the structures' ids, of which `parts` are the numbers; or of the mask.
std::shared_ptr<const Volume> parts_volume(const Reveal& reveal, bool mask) {
  Reveal labels = reveal;
  labels.voxels = reveal.parts;
  labels.ids.assign(reveal.part_ids.size() + 2, mask ? 1 : 0);
  if (mask)
    labels.ids[reveal.part_ids.size() + 1] = 0;
  else
    std::ranges::copy(reveal.part_ids, labels.ids.begin() + 1);
  return std::make_shared<const Volume>(volume_of(labels));
}

/// The structures as a provenance says.
VolumeParts parts_of(const Reveal& reveal, const json& provenance) {
  VolumeParts parts;
  const json recorded = provenance.value("structures", json::object());
  const auto list = [&](const char* member) {
    const json found = recorded.is_object() ? recorded.value(member, json()) : json();
    return found.is_array() ? found : json::array();
  };
  for (const json& id : list("only"))
    if (id.is_number_integer()) parts.only.insert(id.get<std::int64_t>());
  for (const json& one : list("styles")) {
    if (!one.is_object() || !one.value("id", json()).is_number_integer()) continue;
    LabelStyle& style = parts.styles[one["id"].get<std::int64_t>()];
    const json opacity = one.value("opacity", json()), color = one.value("color", json());
    if (opacity.is_number()) style.opacity = std::clamp(opacity.get<double>(), 0.0, 1.0);
    glm::dvec3 rgb(0);
    bool given = color.is_array() && color.size() == 3;
    for (std::size_t k = 0; given && k < 3; ++k)
      if ((given = color[k].is_number())) rgb[static_cast<int>(k)] = color[k].get<double>();
    if (given) style.color = rgb;
  }
  if (reveal.parts.empty()) return parts;
  parts.labels = parts_volume(reveal, false);
  if (reveal.masked) parts.mask = parts_volume(reveal, true);
  return parts;
}

/// Bytes of a scene without its light: voxels, ids, which become numbers, and bricks.
std::uint64_t bytes_of(const Reveal& reveal) {
  const std::uint64_t labels = reveal.ids.empty() ? 0 : sizeof(double) + 2;
  const std::uint64_t parts = reveal.parts.empty() ? 0 : 2 * sizeof(double) + 1;
  return reveal.voxels.size() * (2 + labels + parts);
}

}  // namespace

Volume volume_of(const Reveal& reveal) {
  Volume volume;
  volume.dims = reveal.dims;
  volume.axes = reveal.axes;
  volume.origin = reveal.origin;
  volume.source = "the field's reveal";
  volume.labels = !reveal.ids.empty();
  if (!volume.labels) {
    volume.slope = (reveal.high - reveal.low) / 255;
    volume.intercept = reveal.low;
    volume.voxels = reveal.voxels;
    return volume;
  }
  volume.type = ScalarType::f64;
  volume.voxels.resize(reveal.voxels.size() * sizeof(double));
  auto* const ids = reinterpret_cast<double*>(volume.voxels.data());
  for (std::size_t k = 0; k < reveal.voxels.size(); ++k)
    ids[k] = reveal.ids[std::to_integer<std::size_t>(reveal.voxels[k])];
  return volume;
}

Result<CapSettings> cap_settings(const Reveal& reveal, const std::string& provenance,
                                 std::span<const ClipPlane> clip, const CapOptions& asked) {
  constexpr std::uint64_t kLightBytes = 8 << 20;  // at least
  if (const std::uint64_t needed = bytes_of(reveal) + kLightBytes; asked.memory < needed)
    return fail_without("memory", ErrorCode::usage, "memory ", asked.memory, ": the cut needs ",
                        needed, " bytes");
  const json built = json::parse(provenance, nullptr, /*allow_exceptions=*/false);
  if (built.contains("/lighting/environment"_json_pointer))
    return fail_without("cap", ErrorCode::unsupported,
                        "the field was lit by an environment picture, which it does not keep: "
                        "only a hollow cut can be shown");
  auto transfer = SLF_TRY(
      parse_transfer(built.value("transfer", json()).dump(), "the field's transfer function"));
  CapSettings settings{volume_of(reveal), std::move(transfer), raycast_options(provenance)};
  RaycastOptions& options = settings.options;
  options.clip.insert(options.clip.end(), clip.begin(), clip.end());
  options.parts = parts_of(reveal, built);
  if (reveal.ids.empty()) options.surface_gradient = reveal.gradient;
  // Nodes are as far apart as in the volume, but at least a voxel.
  const glm::dvec3 spacing = settings.volume.spacing();
  const double unit = std::min({spacing.x, spacing.y, spacing.z});
  LightOptions& light = options.lighting;
  light.spacing = std::clamp(light.spacing * reveal.unit / unit, 1.0, 16.0);
  light.memory = std::min(light.memory, asked.memory - bytes_of(reveal));
  if (asked.coarse_light) {
    light.spacing = std::min(2 * light.spacing, 16.0);
    light.samples = std::max(light.samples / 2, 1u);
  }
  return settings;
}

}  // namespace slf
