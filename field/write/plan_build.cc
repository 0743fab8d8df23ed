#include "field/write/plan_build.h"

#include "base/join.h"
#include "base/try.h"

namespace slf {
namespace {

std::string text_of(const glm::dvec3& v) { return concat(v.x, ",", v.y, ",", v.z); }

/// The provenance of a scene, with its recipe.
Result<OwnedJson> provenance_of(const FieldState& state) {
  const auto parsed = [](const std::string& text) {
    return nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  };
  OwnedJson json = parsed(state.scene->provenance());
  if (json->is_object() && !state.recipe.empty()) (*json)["recipe"] = parsed(state.recipe);
  if (json->is_object()) return json;
  return fail(ErrorCode::usage, "the scene's provenance is not a JSON object");
}

}  // namespace

Result<Manifest> plan_build(std::span<const FieldState> states, const BuildOptions& options) {
  Manifest manifest;
  manifest.shape = options.shape;
  const bool scene_bounds = manifest.shape.sphere.radius == 0;
  if (scene_bounds) manifest.shape.sphere = bounds_of(states);
  const auto& [center, radius] = manifest.shape.sphere;
  if (auto ok = manifest.shape.check(); !ok)
    return fail(ok.error().code, scene_bounds ? "around the scene's bounds: " : "",
                ok.error().message);
  for (const FieldState& state : states)
    if (const Sphere visible = state.scene->bounds();
        !(glm::distance(center, visible.center) < radius + visible.radius))
      return fail_without(
          "center", ErrorCode::usage, "a sphere of radius ", radius, " around ", text_of(center),
          " misses all that is visible", state.name.empty() ? "" : " of state ", state.name,
          ", which lies around ", text_of(visible.center), " within ", visible.radius);
  manifest.filtered_levels = manifest.shape.levels;
  manifest.format = sample_format(options.half, options.depth);
  const auto plain = SLF_TRY(codec::make_codec(options.codec, manifest.format));
  manifest.codec = plain->spec();
  SLF_TRY(manifest.check());
  std::vector<std::pair<std::string, OwnedJson>> provenances;
  for (const FieldState& state : states) {
    auto own = SLF_TRY(provenance_of(state));
    provenances.emplace_back(state.name, std::move(own));
  }
  SLF_TRY(manifest.set_states(provenances));
  return manifest;
}

std::uint64_t count_rays(const TileTracer& tracer, const TileOrder& order, unsigned levels,
                         const TileSelection& tiles) {
  std::uint64_t rays = 0;
  for (unsigned level = 0; level <= levels; ++level) {
    const auto [begin, end] = order.level(level);
    rays += (tiles.rank(end) - tiles.rank(begin)) * tracer.work(level);
  }
  return rays;
}

}  // namespace slf
