#include "source/pictures/prepare.h"

#include "base/file.h"
#include "base/try.h"
#include "source/pictures/depth_cache.h"
#include "source/pictures/views.h"

namespace slf {
namespace {

const char* name_of(DepthKind kind) {
  return kind == DepthKind::ray ? "ray" : kind == DepthKind::inverse ? "inverse" : "z";
}

/// Depths of all views by comparing them, or from an earlier run.
Result<void> find_depths(const Sphere& sphere, const Surface* hull,
                         const PictureSceneOptions& options, std::vector<SmallView>& views) {
  const std::string& cache = options.depth_cache;
  const auto estimate = [&] {
    return estimate_depth(sphere, hull, options.threads, options.memory, options.progress, views);
  };
  if (cache.empty()) return estimate();
  // A foreign file is refused before hours of work.
  SLF_TRY(check_own_file(cache, kDepthCacheMagic, "a cache of depths"));
  const std::string key = depth_key(views, sphere, hull ? hull->side() : 0);
  if (read_depth_cache(cache, key, views)) return {};
  SLF_TRY(estimate());
  const auto kept = write_depth_cache(cache, key, views);
  if (!kept && options.on_note)
    options.on_note("depths are not kept for the next run: " + kept.error().message);
  return {};
}

}  // namespace

std::string depth_cache_of(const PictureSet& set) {
  std::string path = set.source;
  while (path.size() > 1 && path.ends_with('/')) path.pop_back();
  return path + ".slf-depths";
}

Result<Prepared> prepare_pictures(PictureSet set, const PictureSceneOptions& options) {
  std::vector<Picture> used;
  for (std::size_t k = 0; k < set.pictures.size(); ++k)
    if (!is_held_out(k, options.holdout)) used.push_back(set.pictures[k]);
  set.pictures = std::move(used);
  if (set.pictures.size() < 2)
    return misuse(set.source, set.pictures.size(), " pictures; expected at least 2");
  Sphere guess = SLF_TRY(options.sphere ? *options.sphere : first_sphere(set));
  auto loaded = SLF_TRY(load_views(guess, options, set));
  if (options.keep_background && loaded.masks)
    return misuse(set.source,
                  "the background cannot be kept: alpha or masks hide it in the pictures");
  if (options.depth == DepthKind::none) loaded.depths = false;
  if (loaded.depths) SLF_TRY(settle_depths(set, options, loaded));

  // The silhouettes give the sphere, if it is not stated.
  Sphere sphere = guess;
  const auto empty = [&] {
    return fail(ErrorCode::failed, set.source,
                ": nothing is inside the silhouettes of all pictures: check that cameras and "
                "pictures belong together, and the sphere");
  };
  if (!options.sphere && loaded.masks) {
    Surface coarse(guess, 96);
    SLF_TRY(carve(loaded.views, options.threads, coarse));
    sphere = coarse.bounds();
    if (sphere.radius == 0) return empty();
  }
  Surface surface(sphere, options.voxels);
  SLF_TRY(carve(loaded.views, options.threads, surface));
  std::optional<Surface> hull;
  std::string depth = "silhouettes";
  if (loaded.depths) {
    depth = name_of(loaded.kind);
  } else if (options.depth != DepthKind::none) {
    SLF_TRY(find_depths(sphere, loaded.masks ? &surface : nullptr, options, loaded.views));
    depth = "estimated";
    if (loaded.masks) hull = surface;
  }
  // A few estimated depths that err would make holes.
  const double hull_weight = hull ? 10 : 0;
  if (depth != "silhouettes")
    SLF_TRY(fuse(loaded.views, loaded.masks, hull_weight, options.threads, surface));
  const Sphere content = surface.bounds();
  if (content.radius == 0) return empty();
  if (!options.sphere && !hull && content.radius < sphere.radius) sphere = content;
  return Prepared{std::move(set),     std::move(loaded), sphere,
                  std::move(surface), std::move(hull),   std::move(depth)};
}

}  // namespace slf
