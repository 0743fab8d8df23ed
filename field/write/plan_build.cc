#include "field/write/plan_build.h"

#include <algorithm>
#include <chrono>

#include "base/join.h"
#include "base/parallel.h"
#include "base/try.h"
#include "field/write/size_estimate.h"
#include "field/write/train_codec.h"
#include "field/write/write_budget.h"

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

/// The tiles of a level that are made. Each takes up to five times its rays, those of the coarser
/// tiles that it is predicted from, too, and those of earlier states.
std::uint64_t sampled_tiles(const FieldShape& shape, unsigned level) {
  const std::uint64_t tiles = shape.tiles(level), most = 320 * std::min(shape.states, 4U);
  return std::min(tiles, std::clamp<std::uint64_t>(tiles / 24, 24, most));
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
  manifest.filtered_levels = manifest.shape.finest_level;
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

Result<BuildForecast> forecast_build(std::span<const FieldState> states,
                                     const BuildOptions& options,
                                     const ProgressCallback& progress) try {
  const auto begin = std::chrono::steady_clock::now();
  const auto manifest = SLF_TRY(plan_build(states, options));
  const FieldShape& shape = manifest.shape;
  std::vector<const Scene*> scenes;
  for (const FieldState& state : states) scenes.push_back(state.scene);
  for (const Scene* scene : scenes) SLF_TRY(scene->prepare());
  const TileTracer tracer(scenes, manifest);
  const TileOrder order(shape);
  const unsigned threads = thread_count(options.threads);
  Progress work;
  for (unsigned level = 0; level <= shape.finest_level; ++level)
    work.total += sampled_tiles(shape, level);
  Reporter reporter(progress, work, "forecast interrupted");
  const auto geometries = [&](unsigned level) -> const LevelGeometry& {
    return tracer.geometry(level);
  };
  const std::chrono::duration<double> prepared = std::chrono::steady_clock::now() - begin;
  const KeptTiles kept_tiles(tracer, cache_share(options.memory));
  const auto codec = SLF_TRY(train_codec(
      kept_tiles, geometries, manifest, threads, [&] { return reporter.go_on(); }, kSketchedRuns));

  const TileCoder coder(shape, manifest.format, *codec, geometries, states.size() > 1,
                        manifest.keeps_rays);
  const CodedTiles coded(kept_tiles, coder);
  const KeptTiles coarser(coded, cache_share(options.memory));
  SizeEstimate total;
  for (unsigned level = 0; level <= shape.finest_level; ++level) {
    const auto sampled = SLF_TRY(sample_tiles(tracer, coarser, coder, order, order.level(level),
                                              sampled_tiles(shape, level), threads, reporter));
    total += sampled;
  }
  TileSelection all;
  all.add({0, order.count()});
  std::size_t kept = codec->tables().size() + options.reveal.size();
  if (options.keep_light) kept += scenes[0]->light().size();
  const FileEstimate file = file_estimate(shape, total, kept);
  return BuildForecast{order.count(),
                       total.sampled,
                       count_rays(tracer, order, shape.finest_level, all),
                       prepared.count() + total.seconds / threads,
                       file.bytes,
                       file.error_bytes};
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
