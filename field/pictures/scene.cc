#include <xxhash.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <stdexcept>

#include "base/file.h"
#include "base/parallel.h"
#include "base/try.h"
#include "field/image/formats.h"
#include "field/pictures/picture_cache.h"
#include "field/pictures/surface.h"
#include "field/pictures/views.h"
#include "field/volume/stack.h"
#include "slf/pictures.h"

namespace slf {
namespace {

/// Depths as they are in the file of a picture of depths, before any scale.
Result<std::vector<float>> read_depths(const std::string& path,
                                       const image_formats::ImageSize& expected) {
  std::vector<float> depths;
  image_formats::ImageSize size;
  if (path.ends_with(".png") || path.ends_with(".PNG")) {
    std::optional<volume_io::SliceKind> kind;
    std::vector<std::byte> samples;
    SLF_TRY(volume_io::append_png(path, {}, kind, samples));
    size = {kind->width, kind->height};
    const bool two = kind->type == ScalarType::u16;
    depths.resize(samples.size() / (two ? 2 : 1));
    for (std::size_t k = 0; k < depths.size(); ++k) {
      std::uint16_t value = std::to_integer<std::uint16_t>(samples[k]);
      if (two) std::memcpy(&value, &samples[2 * k], 2);
      depths[k] = value;
    }
  } else {
    auto image = SLF_TRY(read_image(path));
    size = {image.width, image.height};
    depths = std::move(image.depth);
    if (depths.empty())  // a single channel, which becomes grey
      for (const glm::vec4& p : image.rgba) depths.push_back(p.r);
  }
  if (size != expected)
    return fail(ErrorCode::bad_file, path, ": depths of ", size.width, "x", size.height,
                " pixels beside a picture of ", expected.width, "x", expected.height);
  return depths;
}

/// Decodes a picture, with its mask, and depths as they are in the file.
Result<Image> decode_picture(const Picture& picture, ByteSpan bytes) {
  auto image = image_formats::decode(picture.file, bytes);
  if (!image) return image;
  const image_formats::ImageSize size{image->width, image->height};
  if (size != image_formats::ImageSize{picture.lens.width, picture.lens.height})
    return fail(ErrorCode::bad_file, picture.file, ": is ", size.width, "x", size.height,
                " pixels, not ", picture.lens.width, "x", picture.lens.height, " as before");
  if (!picture.mask.empty()) {
    const auto mask = SLF_TRY(read_image(picture.mask));
    if (image_formats::ImageSize{mask.width, mask.height} != size)
      return fail(ErrorCode::bad_file, picture.mask, ": a mask of ", mask.width, "x", mask.height,
                  " pixels for a picture of ", size.width, "x", size.height);
    for (std::size_t p = 0; p < image->rgba.size(); ++p) image->rgba[p] *= mask.rgba[p].r;
  }
  if (!picture.depth.empty()) {
    auto depths = SLF_TRY(read_depths(picture.depth, size));
    image->depth = std::move(depths);
  }
  return image;
}

constexpr std::uint64_t kMaxPictureBytes = std::uint64_t{1} << 31;

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

/// A sphere that holds the object, before anything of it is known but the cameras.
Result<Sphere> first_sphere(const PictureSet& set) {
  const auto focus = focus_of(set.pictures);
  if (!focus)
    return fail(ErrorCode::usage, set.source,
                ": the cameras all look the same way, so their axes do not show where the object "
                "is: state the centre and radius of the sphere");
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
    return fail(ErrorCode::usage, set.source,
                ": a camera is where all cameras look, so no sphere fits: state its centre and "
                "radius");
  return sphere;
}

struct Loaded {
  std::vector<SmallView> views;
  std::vector<std::uint64_t> hashes;
  bool masks = false;   ///< some pixels are transparent
  bool depths = false;  ///< every picture has depth
  DepthKind kind = DepthKind::unknown;
  double disagreement = 0;  ///< relative, of depths in pairs of pictures
};

/// Median relative difference between depths of views that see the same point, if depths of the
/// files were of this kind.
double disagreement(const std::vector<SmallView>& views, DepthKind kind, double scale) {
  std::vector<double> differences;
  const auto world_z = [&](const SmallView& view, double x, double y, std::size_t p) {
    const glm::dvec3 way((x - view.cx) / view.fx, (y - view.cy) / view.fy, 1);
    return double{along_z(view.depth[p], kind, scale, way)};
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
        if (!(at.z > 0 && at.x >= 0 && at.y >= 0 && at.x < views[other].width &&
              at.y < views[other].height))
          continue;
        const auto ox = static_cast<std::uint32_t>(at.x), oy = static_cast<std::uint32_t>(at.y);
        const double seen =
            world_z(views[other], ox + 0.5, oy + 0.5, std::size_t{oy} * views[other].width + ox);
        if (seen > 0) differences.push_back(std::abs(seen - at.z) / at.z);
      }
  }
  return differences.empty() ? std::numeric_limits<double>::infinity() : median(differences);
}

/// Decodes all pictures once.
Result<Loaded> load_views(const PictureSet& set, const Sphere& sphere,
                          const PictureSceneOptions& options) {
  const std::size_t count = set.pictures.size();
  Loaded loaded;
  loaded.views.resize(count);
  loaded.hashes.resize(count);
  std::vector<Result<void>> results(count);
  std::atomic<std::uint64_t> ready{0}, with_depth{0};
  std::atomic<bool> masks{false}, stopped{false};
  const double voxel = 2 * sphere.radius / options.voxels;
  const auto caller = std::this_thread::get_id();
  SLF_TRY(parallel_for(count, options.threads, [&](std::uint64_t k) {
    if (stopped) return;
    const Picture& picture = set.pictures[k];
    results[k] = [&]() -> Result<void> {
      const auto bytes = SLF_TRY(read_file(picture.file, kMaxPictureBytes));
      loaded.hashes[k] = XXH3_64bits(bytes.data(), bytes.size());
      const auto image = SLF_TRY(decode_picture(picture, bytes));
      const double pixel = glm::distance(picture.eye, sphere.center) / picture.lens.fx;
      loaded.views[k] = make_small_view(
          picture, image, static_cast<std::uint32_t>(std::clamp(voxel / pixel, 1.0, 64.0)));
      with_depth += !image.depth.empty();
      if (std::ranges::any_of(image.rgba, [](const glm::vec4& p) { return p.a < 0.5f; }))
        masks = true;
      return {};
    }();
    ++ready;
    if (options.progress && std::this_thread::get_id() == caller)
      stopped = stopped || !options.progress({ready, count, 0});
  }));
  for (auto& result : results)
    if (!result) return tl::unexpected(std::move(result.error()));
  if (stopped) return fail(ErrorCode::failed, "stopped while pictures were read");
  loaded.masks = masks;
  loaded.depths = with_depth == count;
  if (with_depth > 0 && !loaded.depths)
    return fail(ErrorCode::bad_file, set.source, ": ", with_depth, " of ", count,
                " pictures have depth; expected all or none");
  return loaded;
}

/// Finds the kind of depths, and converts them.
Result<void> settle_depths(const PictureSet& set, const PictureSceneOptions& options,
                           Loaded& loaded) {
  loaded.kind = options.depth;
  const double z = disagreement(loaded.views, DepthKind::z, options.depth_scale),
               ray = disagreement(loaded.views, DepthKind::ray, options.depth_scale);
  constexpr double kConsistent = 0.02;
  if (loaded.kind == DepthKind::unknown) {
    if (!(std::min(z, ray) < kConsistent))
      return fail(ErrorCode::usage, set.source, ": depths of neighbouring pictures disagree, by ",
                  100 * z, " % if they are along z and by ", 100 * ray,
                  " % if they are along the ray: state what they are, and their scale");
    loaded.kind = z <= ray ? DepthKind::z : DepthKind::ray;
  }
  loaded.disagreement = loaded.kind == DepthKind::z ? z
                        : loaded.kind == DepthKind::ray
                            ? ray
                            : disagreement(loaded.views, loaded.kind, options.depth_scale);
  if (!(loaded.disagreement < kConsistent))
    return fail(ErrorCode::usage, set.source, ": depths of neighbouring pictures disagree by ",
                100 * loaded.disagreement, " % (median); along z it were ", 100 * z,
                " %, along the ray ", 100 * ray, " %: check the kind and the scale of depths");
  for (SmallView& view : loaded.views)
    for (std::uint32_t y = 0; y < view.height; ++y)
      for (std::uint32_t x = 0; x < view.width; ++x) {
        float& depth = view.depth[std::size_t{y} * view.width + x];
        depth = along_z(depth, loaded.kind, options.depth_scale,
                        {(x + 0.5 - view.cx) / view.fx, (y + 0.5 - view.cy) / view.fy, 1});
      }
  return {};
}

class PictureScene final : public Scene {
 public:
  PictureScene(PictureSet set, const Sphere& sphere, Surface surface, std::string provenance,
               std::uint64_t memory)
      : set_(std::move(set)),
        sphere_(sphere),
        surface_(std::move(surface)),
        provenance_(std::move(provenance)),
        cache_(set_.pictures.size(), memory, [this](std::size_t k) { return load(k); }) {
    double finest = std::numeric_limits<double>::max();
    for (const Picture& picture : set_.pictures)
      finest = std::min(finest, pixel_at(picture, sphere_.center));
    for (const Picture& picture : set_.pictures)
      coarseness_.push_back(0.1 * std::log2(pixel_at(picture, sphere_.center) / finest));
  }

  [[nodiscard]] Sphere bounds() const override { return sphere_; }
  [[nodiscard]] std::string provenance() const override { return provenance_; }
  [[nodiscard]] std::vector<std::string> files() const override {
    std::vector<std::string> files{set_.source};
    for (const Picture& picture : set_.pictures)
      for (const std::string* file : {&picture.file, &picture.mask, &picture.depth})
        if (!file->empty()) files.push_back(*file);
    return files;
  }

  [[nodiscard]] RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override {
    RaySample sample;
    const Segment ray{from, to};
    trace_many({&ray, 1}, {&sample, 1});
    return sample;
  }

  void trace_many(std::span<const Segment> rays, std::span<RaySample> out) const override {
    Held held(set_.pictures.size());
    for (std::size_t k = 0; k < rays.size(); ++k) out[k] = trace(rays[k], held);
  }

 private:
  /// The pictures that a batch of rays uses.
  using Held = std::vector<std::shared_ptr<const Pixels>>;

  static constexpr std::size_t kBlended = 4;      ///< pictures that colour a ray, at most
  static constexpr std::size_t kCandidates = 16;  ///< pictures that are asked whether they see it

  static double pixel_at(const Picture& picture, const glm::dvec3& place) {
    return glm::distance(picture.eye, place) / picture.lens.fx;
  }

  /// What is asked of a picture about a point: the colour of the surface that a ray met there, or
  /// of what a ray passed, or of anything in this direction.
  enum class Ask : std::uint8_t { met, passed, hidden };

  /// How a picture sees a point.
  struct Sight {
    double penalty = 0;
    double share = 0;  ///< of the point that is not hidden, 0 to 1
    glm::vec4 rgba{0};
  };

  [[nodiscard]] RaySample trace(const Segment& ray, Held& held) const {
    using Kind = Surface::Meeting::Kind;
    const auto meeting = surface_.meet(ray.from, ray.to);
    if (meeting.kind == Kind::none) return {};
    const glm::dvec3 point = ray.from + meeting.t * (ray.to - ray.from);
    const glm::dvec3 back = glm::normalize(ray.from - ray.to);

    // The pictures whose directions are nearest.
    std::array<std::pair<double, std::size_t>, kCandidates> nearest;
    std::size_t count = 0;
    for (std::size_t k = 0; k < set_.pictures.size(); ++k) {
      const glm::dvec3 toward = set_.pictures[k].eye - point;
      const double cosine = glm::dot(toward, back) / glm::length(toward);
      // 1 - cosine orders as the angle does; see penalty() for the rest.
      const double penalty = std::sqrt(std::max(0.0, 2 - 2 * cosine)) + coarseness_[k];
      if (count == kCandidates && penalty >= nearest[count - 1].first) continue;
      if (count < kCandidates) ++count;
      std::size_t at = count - 1;
      for (; at > 0 && nearest[at - 1].first > penalty; --at) nearest[at] = nearest[at - 1];
      nearest[at] = {penalty, k};
    }

    // Weights reach zero where another picture takes over, so that colours are continuous
    // (Buehler et al. 2001, section 3).
    std::array<Sight, kBlended + 1> sights;
    std::size_t seen = 0;
    const auto look_from = [&](Ask ask) {
      for (std::size_t k = 0; k < count && seen < sights.size(); ++k) {
        const auto [penalty, picture] = nearest[k];
        const auto sight = look(point, picture, penalty, ask, held);
        if (sight.share > 0.05) sights[seen++] = sight;
      }
    };
    look_from(meeting.kind == Kind::near ? Ask::passed : Ask::met);
    // No picture sees into some cavities; any colour of the object there is better than a hole.
    if (seen == 0 && meeting.kind == Kind::hit) look_from(Ask::hidden);
    if (seen == 0) return {};
    const double end =
        seen == sights.size() ? sights[seen - 1].penalty : sights[seen - 1].penalty * 1.1 + 0.01;
    glm::dvec4 sum(0);
    double weights = 0;
    for (std::size_t k = 0; k < seen; ++k) {
      const Sight& sight = sights[k];
      const double weight =
          sight.share * std::max(0.0, 1 - sight.penalty / end) / (sight.penalty + 0.02);
      sum += weight * glm::dvec4(sight.rgba);
      weights += weight;
    }
    if (!(weights > 0)) return {};
    RaySample sample;
    sample.rgba = glm::vec4(sum / weights);
    if (sample.rgba.a < 1.0f / 512) return {};
    sample.depth = static_cast<float>(meeting.t);
    return sample;
  }

  [[nodiscard]] Sight look(const glm::dvec3& point, std::size_t number, double penalty, Ask ask,
                           Held& held) const {
    const Picture& picture = set_.pictures[number];
    const glm::dvec3 v = picture.to_camera(point);
    const auto place = picture.lens.project(v);
    const Lens& lens = picture.lens;
    if (!place) return {};
    const double edge =
        std::min({place->x, place->y, lens.width - place->x, lens.height - place->y});
    if (!(edge > 0)) return {};
    if (!held[number]) held[number] = cache_.get(number);
    const Pixels& pixels = *held[number];

    // What of the pixel sees the point, and what sees past it.
    const double dx = std::clamp(place->x / pixels.depth_factor - 0.5, 0.0,
                                 pixels.depth_width - 1.001),
                 dy = std::clamp(place->y / pixels.depth_factor - 0.5, 0.0,
                                 pixels.depth_height - 1.001);
    const auto ix = static_cast<std::size_t>(dx), iy = static_cast<std::size_t>(dy);
    const double fx = dx - static_cast<double>(ix), fy = dy - static_cast<double>(iy);
    const double tolerance = 2.5 * surface_.voxel();
    double visible = 0, beyond = 0;
    for (std::size_t b = 0; b < 2; ++b)
      for (std::size_t a = 0; a < 2; ++a) {
        const double weight = (a ? fx : 1 - fx) * (b ? fy : 1 - fy);
        const float depth = pixels.depth[(iy + b) * pixels.depth_width + ix + a];
        const bool in_front = v.z < depth - 2 * tolerance;
        // A pixel that sees past a point on the surface is at the edge of another part.
        if (ask == Ask::hidden || (v.z <= depth + tolerance && !(ask == Ask::met && in_front)))
          visible += weight;
        if (std::isfinite(depth) && in_front) beyond += weight;
      }
    Sight sight;
    sight.penalty = penalty;
    sight.share = visible * std::min(1.0, edge / (0.03 * lens.width));
    sight.rgba = pixels.sample(*place);
    // Where the ray only passes the object, a picture that sees something behind shows that the
    // point is empty.
    if (ask == Ask::passed) sight.rgba *= static_cast<float>(1 - beyond);
    return sight;
  }

  /// Throws std::runtime_error if the picture cannot be read.
  [[nodiscard]] std::shared_ptr<const Pixels> load(std::size_t number) const {
    const Picture& picture = set_.pictures[number];
    const auto bytes = read_file(picture.file, kMaxPictureBytes);
    if (!bytes) throw std::runtime_error(bytes.error().message);
    Picture colors = picture;
    colors.depth.clear();
    auto image = decode_picture(colors, *bytes);
    if (!image) throw std::runtime_error(image.error().message);
    auto pixels = std::make_shared<Pixels>(*image);
    const Lens& lens = picture.lens;
    const double pixel = pixel_at(picture, sphere_.center);
    const auto factor = static_cast<std::uint32_t>(std::clamp(surface_.voxel() / pixel, 1.0, 64.0));
    pixels->depth_factor = factor;
    pixels->depth_width = std::max(2u, (lens.width + factor - 1) / factor);
    pixels->depth_height = std::max(2u, (lens.height + factor - 1) / factor);
    pixels->depth.reserve(std::size_t{pixels->depth_width} * pixels->depth_height);
    for (std::uint32_t y = 0; y < pixels->depth_height; ++y)
      for (std::uint32_t x = 0; x < pixels->depth_width; ++x)
        pixels->depth.push_back(depth_at(picture, {(x + 0.5) * factor, (y + 0.5) * factor}));
    return pixels;
  }

  /// Of the surface, along z; infinity where a picture sees none.
  [[nodiscard]] float depth_at(const Picture& picture, const glm::dvec2& place) const {
    constexpr float kNone = std::numeric_limits<float>::infinity();
    const glm::dvec3 in_camera = picture.lens.direction(place);
    const glm::dvec3 way = picture.axes * in_camera;
    const Chord chord = intersect(sphere_, picture.eye, way);
    if (!chord.hit || chord.leave <= 0) return kNone;
    const double enter = std::max(chord.enter, 0.0), leave = chord.leave;
    const auto meeting = surface_.meet(picture.eye + enter * way, picture.eye + leave * way);
    if (meeting.kind != Surface::Meeting::Kind::hit) return kNone;
    return static_cast<float>((enter + meeting.t * (leave - enter)) * in_camera.z);
  }

  PictureSet set_;
  Sphere sphere_;
  Surface surface_;
  std::string provenance_;
  std::vector<double> coarseness_;  ///< penalty of each picture for its resolution
  mutable PictureCache cache_;
};

const char* name_of(DepthKind kind) {
  return kind == DepthKind::ray ? "ray" : kind == DepthKind::inverse ? "inverse" : "z";
}

}  // namespace

Result<Image> load_picture(const Picture& picture) {
  const auto bytes = SLF_TRY(read_file(picture.file, kMaxPictureBytes));
  return decode_picture(picture, bytes);
}

Result<std::unique_ptr<Scene>> make_picture_scene(PictureSet set,
                                                  const PictureSceneOptions& options) {
  std::vector<Picture> used;
  for (std::size_t k = 0; k < set.pictures.size(); ++k)
    if (!is_held_out(k, options.holdout)) used.push_back(set.pictures[k]);
  set.pictures = std::move(used);
  if (set.pictures.size() < 2)
    return fail(ErrorCode::usage, set.source, ": ", set.pictures.size(),
                " pictures; expected at least 2");
  Sphere guess = SLF_TRY(options.sphere ? *options.sphere : first_sphere(set));
  auto loaded = SLF_TRY(load_views(set, guess, options));
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
  if (loaded.masks) {
    SLF_TRY(carve(loaded.views, options.threads, surface));
  } else {
    for (std::size_t k = 0; k < std::size_t{surface.side()} * surface.side() * surface.side(); ++k)
      surface.set(k, -1);
    surface.finish();
  }
  std::string depth = "silhouettes";
  if (loaded.depths) {
    depth = name_of(loaded.kind);
  } else if (options.depth != DepthKind::none) {
    SLF_TRY(estimate_depth(sphere, loaded.masks ? &surface : nullptr, options.threads,
                           options.progress, loaded.views));
    depth = "estimated";
  }
  if (depth != "silhouettes") SLF_TRY(fuse(loaded.views, loaded.masks, options.threads, surface));
  const Sphere content = surface.bounds();
  if (content.radius == 0) return empty();
  if (!options.sphere && content.radius < sphere.radius) sphere = content;

  XXH64_hash_t hash =
      XXH3_64bits(loaded.hashes.data(), loaded.hashes.size() * sizeof(std::uint64_t));
  const std::string cameras = transforms_json(set.pictures, "");
  hash = XXH3_64bits_withSeed(cameras.data(), cameras.size(), hash);
  nlohmann::json provenance{
      {"kind", "pictures"},         {"source", set.source}, {"pictures", set.pictures.size()},
      {"holdout", options.holdout}, {"depth", depth},       {"depth_scale", options.depth_scale},
      {"voxels", options.voxels},   {"content", hash}};
  return std::unique_ptr<Scene>(new PictureScene(std::move(set), sphere, std::move(surface),
                                                 provenance.dump(), options.memory));
}

}  // namespace slf
