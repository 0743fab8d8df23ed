#include "source/pictures/prepare.h"

#include <xxhash.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

#include "base/file.h"
#include "base/join.h"
#include "base/reporter.h"
#include "base/try.h"
#include "image/formats.h"
#include "source/pictures/cameras.h"
#include "source/pictures/depth_cache.h"
#include "source/pictures/views.h"
#include "source/volume/stack.h"
#include "source/volume/voxels.h"

namespace slf {
namespace {

/// Depths as they are in the file of a picture of depths, before any scale.
Result<std::vector<float>> read_depths(const std::string& path,
                                       const image_formats::ImageSize& expected) {
  std::vector<float> depths;
  image_formats::ImageSize size;
  const auto head = SLF_TRY(volume_io::read_head(path, 8));
  const bool png = volume_io::looks_like_png(head);
  if (png || volume_io::looks_like_tiff(head)) {
    // The samples as they are stored, and not as colours.
    std::optional<volume_io::SliceKind> kind;
    std::vector<std::byte> samples;
    const auto& append = png ? volume_io::append_png : volume_io::append_tiff;
    SLF_TRY(append(path, {}, kind, samples));
    size = {kind->width, kind->height};
    if (const auto type = kind->type;
        type != ScalarType::u8 && type != ScalarType::u16 && type != ScalarType::f32)
      return unsupported(path, "depths of type ", name(type),
                         "; expected 8 or 16 bits without sign, or 32-bit float");
    with_type(kind->type, [&]<class T>(T value) {
      for (std::size_t at = 0; at + sizeof(T) <= samples.size(); at += sizeof(T)) {
        std::memcpy(&value, &samples[at], sizeof(T));
        depths.push_back(static_cast<float>(value));
      }
    });
    if (depths.size() != std::size_t{size.width} * size.height)
      return bad_file(path, "has more than one page; expected a single picture");
  } else {
    auto image = SLF_TRY(read_image(path));
    size = {image.width, image.height};
    depths = std::move(image.depth);
    if (depths.empty())  // a single channel, which becomes grey
      for (const glm::vec4& p : image.rgba) depths.push_back(p.r);
  }
  if (size != expected)
    return bad_file(path, "depths of ", size.width, "x", size.height,
                    " pixels beside a picture of ", expected.width, "x", expected.height);
  return depths;
}

/// Where a mask shows the object: where it is not 0, of a palette the index. JPEG blurs, so there
/// half of white is the limit.
Result<std::vector<bool>> read_mask(const std::string& path,
                                    const image_formats::ImageSize& expected) {
  const auto head = SLF_TRY(volume_io::read_head(path, 8));
  std::optional<volume_io::SliceKind> kind;
  std::vector<std::byte> samples;
  std::vector<bool> mask;
  image_formats::ImageSize size;
  auto image = volume_io::looks_like_png(head) ? Result<Image>() : read_image(path);
  if (volume_io::looks_like_png(head)) {
    kind = SLF_TRY(volume_io::read_png_as_stored(path, samples));
  } else if (!image && volume_io::looks_like_tiff(head)) {  // with a palette, perhaps
    SLF_TRY(volume_io::append_tiff(path, {.component = 0}, kind, samples));
    kind->components = 1;
  } else if (!image) {
    return tl::unexpected(image.error());
  }
  if (kind) {
    size = {kind->width, kind->height};
    const std::size_t width = bytes_per_voxel(kind->type), pixel = width * kind->components;
    const std::size_t colors = kind->alpha ? pixel - width : pixel;
    const auto is_set = [](std::byte b) { return b != std::byte{0}; };
    for (std::size_t at = 0; at + pixel <= samples.size(); at += pixel) {
      const std::span<const std::byte> all(&samples[at], pixel);
      mask.push_back(std::ranges::any_of(all.first(colors), is_set) &&
                     (!kind->alpha || std::ranges::any_of(all.subspan(colors), is_set)));
    }
  } else {
    size = {image->width, image->height};
    const float limit = volume_io::looks_like_jpeg(head) ? 0.5f : 0;
    for (const glm::vec4& p : image->rgba) mask.push_back(std::max({p.r, p.g, p.b}) > limit);
  }
  if (size != expected || mask.size() != std::size_t{size.width} * size.height)
    return bad_file(path, "a mask of ", size.width, "x", size.height, " pixels for a picture of ",
                    expected.width, "x", expected.height);
  return mask;
}

/// The depth along z of what a file states for the pixel in direction `way`; 0: not known.
float along_z(float stated, DepthKind kind, double scale, const glm::dvec3& way) {
  if (!(stated > 0) || !std::isfinite(stated)) return 0;
  const double value = stated * scale;
  const double z = kind == DepthKind::inverse ? 1 / value
                   : kind == DepthKind::ray   ? value * way.z / glm::length(way)
                                              : value;
  return std::isfinite(z) && z > 0 ? static_cast<float>(z) : 0;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Median relative difference between depths of views that see the same point, if depths of the
/// files were of this kind.
double disagreement(const std::vector<SmallView>& views, DepthKind kind, double scale) {
  std::vector<double> differences;
  const auto world_z = [&](const SmallView& view, double x, double y, std::size_t p) {
    return double{along_z(view.depth[p], kind, scale, view.in_camera(x, y))};
  };
  for (std::size_t k = 0; k < views.size(); ++k) {
    const SmallView& view = views[k];
    std::size_t other = k;
    double best = std::numeric_limits<double>::max();
    for (std::size_t j = 0; j < views.size(); ++j)
      if (const double d = glm::distance(views[j].eye, view.eye); j != k && d > 0 && d < best)
        best = d, other = j;
    if (other == k) continue;
    for (std::uint32_t y = 0; y < view.height; y += 4)
      for (std::uint32_t x = 0; x < view.width; x += 4) {
        const std::size_t p = std::size_t{y} * view.width + x;
        const double z = world_z(view, x + 0.5, y + 0.5, p);
        if (!(z > 0) || view.rgba[p].a < 250) continue;
        const glm::dvec3 at = views[other].project(view.eye + z * view.direction(x + 0.5, y + 0.5));
        const auto pixel = views[other].pixel_at(at);
        if (!pixel) continue;
        const double seen =
            world_z(views[other], std::floor(at.x) + 0.5, std::floor(at.y) + 0.5, *pixel);
        if (seen > 0) differences.push_back(std::abs(seen - at.z) / at.z);
      }
  }
  return differences.empty() ? std::numeric_limits<double>::infinity() : median(differences);
}

}  // namespace

Result<Image> decode_picture(const Picture& picture, ByteSpan bytes) {
  auto image = image_formats::decode(picture.file, bytes);
  if (!image) return image;
  const image_formats::ImageSize size{image->width, image->height};
  if (size != image_formats::ImageSize{picture.lens.width, picture.lens.height})
    return bad_file(picture.file, "is ", size.width, "x", size.height, " pixels, not ",
                    picture.lens.width, "x", picture.lens.height, " as before");
  if (!picture.mask.empty()) {
    const auto mask = SLF_TRY(read_mask(picture.mask, size));
    for (std::size_t p = 0; p < image->rgba.size(); ++p)
      if (!mask[p]) image->rgba[p] = glm::vec4(0);
  }
  if (!picture.depth.empty()) {
    auto depths = SLF_TRY(read_depths(picture.depth, size));
    image->depth = std::move(depths);
  }
  return image;
}

Result<Image> load_picture(const Picture& picture) try {
  const auto bytes = SLF_TRY(read_file(picture.file, kMaxPictureBytes));
  return decode_picture(picture, bytes);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

namespace {

/// A sphere that holds the object, before anything of it is known but the cameras. usage: they do
/// not show where it is.
Result<Sphere> first_sphere(const PictureSet& set) {
  const auto focus = focus_of(set.pictures);
  if (!focus)
    return fail_without("sphere", ErrorCode::usage, set.source,
                        ": the cameras all look the same way, so their axes do not show where the "
                        "object is: state the centre and radius of the sphere");
  std::vector<double> radii;
  double nearest = std::numeric_limits<double>::max();
  for (const Picture& picture : set.pictures) {
    const double distance = glm::distance(picture.eye, *focus);
    const Lens& lens = picture.lens;
    const double half =
        std::max(std::atan(lens.width / 2.0 / lens.fx), std::atan(lens.height / 2.0 / lens.fy));
    radii.push_back(distance * std::sin(std::min(half, 1.4)));
    nearest = std::min(nearest, distance);
  }
  Sphere sphere{*focus, std::min(median(radii), 0.95 * nearest)};
  if (!set.points.empty()) {
    std::vector<double> distances;
    for (const glm::dvec3& p : set.points) distances.push_back(glm::distance(p, *focus));
    sphere.radius = std::min(1.5 * median(distances), 0.7 * nearest);
  }
  if (!(sphere.radius > 0) || !std::isfinite(sphere.radius))
    return fail_without(
        "sphere", ErrorCode::usage, set.source,
        ": a camera is where all cameras look, so no sphere fits: state its centre and radius");
  return sphere;
}

/// Decodes all pictures, and takes those that are damaged out of the set, with a note. `sphere`
/// says how fine views must be. Errors of decode_picture(), if fewer than two pictures remain;
/// cancelled: stopped by the options' progress.
Result<Loaded> load_views(const Sphere& sphere, const PictureSceneOptions& options,
                          PictureSet& set) {
  const std::size_t count = set.pictures.size();
  Loaded loaded;
  loaded.views.resize(count);
  loaded.hashes.resize(count);
  std::vector<Result<void>> results(count);
  std::atomic<bool> masks{false};
  const double voxel = 2 * sphere.radius / options.voxels;
  Reporter reporter(options.progress, {0, count, 0}, "stopped while pictures were read");
  SLF_TRY(parallel_for(count, options.threads, reporter, [&](std::uint64_t k) {
    const Picture& picture = set.pictures[k];
    results[k] = [&]() -> Result<void> {
      const auto bytes = SLF_TRY(read_file(picture.file, kMaxPictureBytes));
      std::uint64_t& hash = loaded.hashes[k] = XXH3_64bits(bytes.data(), bytes.size());
      for (std::uint64_t kind = 1; const std::string& file : {picture.mask, picture.depth}) {
        if (++kind, file.empty()) continue;
        const auto more = SLF_TRY(read_file(file, kMaxPictureBytes));
        hash = XXH3_64bits_withSeed(more.data(), more.size(), hash + kind);
      }
      const auto image = SLF_TRY(decode_picture(picture, bytes));
      const double pixel = glm::distance(picture.eye, sphere.center) / picture.lens.fx;
      loaded.views[k] = make_small_view(
          picture, image, static_cast<std::uint32_t>(std::clamp(voxel / pixel, 1.0, 64.0)));
      if (std::ranges::any_of(image.rgba, [](const glm::vec4& p) { return p.a < 0.5f; }))
        masks = true;
      return {};
    }();
  }));
  cameras::LeftOut left_out;
  std::size_t kept = 0, with_depth = 0;
  for (std::size_t k = 0; k < count; ++k) {
    if (!results[k]) {
      SLF_TRY(left_out.add(std::move(results[k].error())));
      continue;
    }
    with_depth += loaded.views[k].depth.empty() ? 0 : 1;
    if (kept != k) {
      set.pictures[kept] = std::move(set.pictures[k]);
      loaded.views[kept] = std::move(loaded.views[k]);
      loaded.hashes[kept] = loaded.hashes[k];
    }
    ++kept;
  }
  set.pictures.resize(kept);
  loaded.views.resize(kept);
  loaded.hashes.resize(kept);
  std::vector<std::string> notes;
  SLF_TRY(left_out.settle(kept, notes));
  loaded.masks = masks;
  loaded.depths = with_depth > 0 && 2 * with_depth >= kept;
  if (with_depth > 0 && with_depth < kept)
    notes.push_back(concat(with_depth, " of ", kept, " pictures have depth: ",
                           loaded.depths ? "of the others, it is not known" : "it is not used"));
  for (SmallView& view : loaded.views) view.depth.resize(loaded.depths ? view.rgba.size() : 0);
  for (const std::string& note : notes)
    if (options.on_note) options.on_note(set.source + ": " + note);
  return loaded;
}

/// Finds the kind of depths, and converts them to depths along z in world units. usage: depths of
/// neighbouring pictures disagree.
Result<void> settle_depths(const PictureSet& set, const PictureSceneOptions& options,
                           Loaded& loaded) {
  loaded.kind = options.depth;
  const double z = disagreement(loaded.views, DepthKind::z, options.depth_scale),
               ray = disagreement(loaded.views, DepthKind::ray, options.depth_scale);
  constexpr double kConsistent = 0.02;
  if (loaded.kind == DepthKind::unknown) {
    if (!(std::min(z, ray) < kConsistent))
      return fail_without("depth", ErrorCode::usage, set.source,
                          ": depths of neighbouring pictures disagree, by ", 100 * z,
                          " % if they are along z and by ", 100 * ray,
                          " % if they are along the ray: state what they are, and their scale");
    loaded.kind = z <= ray ? DepthKind::z : DepthKind::ray;
  }
  loaded.disagreement = loaded.kind == DepthKind::z ? z
                        : loaded.kind == DepthKind::ray
                            ? ray
                            : disagreement(loaded.views, loaded.kind, options.depth_scale);
  if (!(loaded.disagreement < kConsistent))
    return misuse(set.source, "depths of neighbouring pictures disagree by ",
                  100 * loaded.disagreement, " % (median); along z it were ", 100 * z,
                  " %, along the ray ", 100 * ray, " %: check the kind and the scale of depths");
  for (SmallView& view : loaded.views)
    for (std::uint32_t y = 0; y < view.height; ++y)
      for (std::uint32_t x = 0; x < view.width; ++x) {
        float& depth = view.depth[std::size_t{y} * view.width + x];
        depth = along_z(depth, loaded.kind, options.depth_scale, view.in_camera(x + 0.5, y + 0.5));
      }
  return {};
}

const char* name_of(DepthKind kind) {
  return kind == DepthKind::ray ? "ray" : kind == DepthKind::inverse ? "inverse" : "z";
}

/// Depths of all views by comparing them, or from an earlier run.
Result<void> find_depths(const Sphere& sphere, const DistanceField* hull,
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
    DistanceField coarse(guess, 96);
    SLF_TRY(carve(loaded.views, options.threads, coarse));
    sphere = coarse.bounds();
    if (sphere.radius == 0) return empty();
  }
  DistanceField surface(sphere, options.voxels);
  SLF_TRY(carve(loaded.views, options.threads, surface));
  std::optional<DistanceField> hull;
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
