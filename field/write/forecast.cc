#include <algorithm>
#include <chrono>

#include "base/parallel.h"
#include "base/try.h"
#include "field/write/plan_build.h"
#include "field/write/size_estimate.h"
#include "field/write/train_codec.h"

namespace slf {
namespace {

/// The tiles of a level that are made. Each takes up to five times its rays, those of the coarser
/// tiles that it is predicted from, too.
std::uint64_t sampled_tiles(const FieldShape& shape, unsigned level) {
  const std::uint64_t tiles = shape.tiles(level);
  return std::min(tiles, std::clamp<std::uint64_t>(tiles / 24, 24, 160));
}

}  // namespace

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
  for (unsigned level = 0; level <= shape.levels; ++level)
    work.total += sampled_tiles(shape, level);
  Reporter reporter(progress, work, "forecast interrupted");
  const auto geometries = [&](unsigned level) -> const LevelGeometry& {
    return tracer.geometry(level);
  };
  const auto codec =
      SLF_TRY(train_codec(tracer, geometries, manifest, threads, [&] { return reporter.go_on(); }));
  const std::chrono::duration<double> prepared = std::chrono::steady_clock::now() - begin;

  const TileCoder coder(shape, manifest.format, *codec, geometries, states.size() > 1,
                        manifest.keeps_rays);
  SizeEstimate total;
  for (unsigned level = 0; level <= shape.levels; ++level) {
    const auto sampled = SLF_TRY(sample_tiles(tracer, coder, order, order.level(level),
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
                       count_rays(tracer, order, shape.levels, all),
                       prepared.count() + total.seconds / threads,
                       file.bytes,
                       file.error_bytes};
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
