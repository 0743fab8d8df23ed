#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <list>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <vector>

#include "base/try.h"
#include "slf/pictures.h"
#include "source/pictures/camera_index.h"
#include "source/pictures/prepare.h"

namespace slf {
namespace {

/// A decoded picture: 8 bits or, where it may hold more, floats.
class Pixels {
 public:
  explicit Pixels(const Image& image) : width_(image.width), height_(image.height) {
    const bool small = std::ranges::all_of(image.rgba, [](const glm::vec4& p) {
      const glm::vec4 scaled = p * 255.0f;
      return p.r >= 0 && p.g >= 0 && p.b >= 0 && std::max({p.r, p.g, p.b, p.a}) <= 1 &&
             // Premultiplied 8-bit colours are no whole numbers, and lose little.
             std::abs(scaled.a - std::round(scaled.a)) < 1e-3f;
    });
    if (!small) {
      large_ = image.rgba;
      return;
    }
    small_.reserve(image.rgba.size());
    for (const glm::vec4& p : image.rgba) small_.emplace_back(p * 255.0f + 0.5f);
  }

  /// Bilinear, premultiplied. Places outside are those at the edge.
  [[nodiscard]] glm::vec4 sample(const glm::dvec2& place) const {
    const double x = std::clamp(place.x - 0.5, 0.0, width_ - 1.0),
                 y = std::clamp(place.y - 0.5, 0.0, height_ - 1.0);
    const auto ix = static_cast<std::size_t>(x), iy = static_cast<std::size_t>(y);
    const std::size_t right = ix + 1 < width_ ? 1 : 0, below = iy + 1 < height_ ? width_ : 0;
    const std::size_t at = iy * width_ + ix;
    const auto fx = static_cast<float>(x - static_cast<double>(ix)),
               fy = static_cast<float>(y - static_cast<double>(iy));
    const glm::vec4 top = glm::mix(pixel(at), pixel(at + right), fx);
    return glm::mix(top, glm::mix(pixel(at + below), pixel(at + below + right), fx), fy);
  }

  [[nodiscard]] std::size_t bytes() const {
    return small_.size() * sizeof(glm::u8vec4) + large_.size() * sizeof(glm::vec4) +
           depth.size() * sizeof(float);
  }

  /// What the object's surface hides: depths along z in pixels `depth_factor` times as large.
  std::vector<float> depth;
  std::uint32_t depth_width = 0, depth_height = 0, depth_factor = 1;

 private:
  [[nodiscard]] glm::vec4 pixel(std::size_t at) const {
    return large_.empty() ? glm::vec4(small_[at]) / 255.0f : large_[at];
  }

  std::uint32_t width_, height_;
  std::vector<glm::u8vec4> small_;
  std::vector<glm::vec4> large_;
};

/// Decoded pictures within a budget of memory. Thread-safety: any thread.
class PictureCache {
 public:
  using Load = std::function<std::shared_ptr<const Pixels>(std::size_t)>;
  PictureCache(std::size_t pictures, std::uint64_t budget, Load load)
      : budget_(budget), load_(std::move(load)), slots_(pictures) {}

  /// Loads the picture if it is not in memory; throws what the loader throws.
  [[nodiscard]] std::shared_ptr<const Pixels> get(std::size_t picture) {
    Slot& slot = slots_[picture];
    const auto find = [&]() -> std::shared_ptr<const Pixels> {
      const std::lock_guard lock(mutex_);
      if (slot.pixels) recent_.splice(recent_.begin(), recent_, slot.place);
      return slot.pixels;
    };
    if (auto found = find()) return found;
    const std::lock_guard loading(slot.loading);  // others wait instead of loading it, too
    if (auto found = find()) return found;
    auto pixels = load_(picture);
    const std::lock_guard lock(mutex_);
    slot.pixels = pixels;
    recent_.push_front(picture);
    slot.place = recent_.begin();
    used_ += pixels->bytes();
    while (used_ > budget_ && recent_.size() > 1) {
      Slot& oldest = slots_[recent_.back()];
      used_ -= oldest.pixels->bytes();
      oldest.pixels.reset();
      recent_.pop_back();
    }
    return pixels;
  }

 private:
  struct Slot {
    std::mutex loading;
    std::shared_ptr<const Pixels> pixels;
    std::list<std::size_t>::iterator place;
  };
  std::uint64_t budget_;
  Load load_;
  std::mutex mutex_;  // guards all but Slot::loading
  std::vector<Slot> slots_;
  std::list<std::size_t> recent_;  // the most recently used first
  std::uint64_t used_ = 0;
};

class PictureScene final : public Scene {
 public:
  PictureScene(Prepared found, std::string provenance, const PictureSceneOptions& options)
      : set_(std::move(found.set)),
        sphere_(found.sphere),
        surface_(std::move(found.surface)),
        hull_(std::move(found.hull)),
        keep_background_(options.keep_background),
        provenance_(std::move(provenance)),
        cache_(set_.pictures.size(), options.memory, [this](std::size_t k) { return load(k); }) {
    double finest = std::numeric_limits<double>::max();
    for (const Picture& picture : set_.pictures)
      finest = std::min(finest, pixel_at(picture, sphere_.center));
    std::vector<glm::dvec3> eyes;
    std::vector<double> coarseness;  // the penalty of each picture for its resolution
    for (const Picture& picture : set_.pictures) {
      eyes.push_back(picture.eye);
      coarseness.push_back(0.1 * std::log2(pixel_at(picture, sphere_.center) / finest));
    }
    index_ = CameraIndex(eyes, coarseness);
  }

  [[nodiscard]] Sphere bounds() const override { return sphere_; }
  [[nodiscard]] std::string provenance() const override { return provenance_; }
  [[nodiscard]] std::vector<std::string> files() const override { return set_.files(); }

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
  /// of what a ray passed, or of anything in this direction, or of what is behind the object.
  enum class Ask : std::uint8_t { met, passed, hidden, behind };

  /// How a picture sees a point.
  struct Sight {
    double penalty = 0;
    double share = 0;  ///< of the point that is not hidden, 0 to 1
    glm::vec4 rgba{0};
  };

  [[nodiscard]] RaySample trace(const Segment& ray, Held& held) const {
    RaySample sample = trace_object(ray, held);
    if (!keep_background_ || sample.rgba.a > 1 - 1.0f / 512) return sample;
    const Chord chord = intersect(sphere_, ray.from, ray.to - ray.from);
    if (!chord.hit || chord.leave <= 0) return sample;
    const double t = std::min(chord.leave, 1.0);
    const auto behind = blend(ray, t, Ask::behind, held);
    const glm::vec4 rgba = (1 - sample.rgba.a) * behind.value_or(glm::vec4(0));
    if (!(rgba.a > 0)) return sample;
    // The mean, weighted by opacity.
    const double share = rgba.a / (rgba.a + sample.rgba.a);
    sample.depth =
        static_cast<float>(share * t + (share < 1 ? (1 - share) * double{sample.depth} : 0.0));
    sample.rgba += rgba;
    return sample;
  }

  [[nodiscard]] RaySample trace_object(const Segment& ray, Held& held) const {
    using Kind = DistanceField::Meeting::Kind;
    auto meeting = surface_.meet(ray.from, ray.to);
    if (meeting.kind == Kind::none) meeting = pass_through_hull(ray);
    if (meeting.kind == Kind::none) return {};
    auto rgba = blend(ray, meeting.t, meeting.kind == Kind::near ? Ask::passed : Ask::met, held);
    // No picture sees this place. With a hull, it is mostly outside the object, where the hull is
    // too large, as below an object pictured from above. Without, it is in a cavity, where any
    // colour is better than a hole.
    if (!rgba && meeting.kind == Kind::hit && !hull_)
      rgba = blend(ray, meeting.t, Ask::hidden, held);
    if (!rgba || rgba->a < 1.0f / 512) return {};
    RaySample sample;
    sample.rgba = *rgba;
    sample.depth = static_cast<float>(meeting.t);
    return sample;
  }

  /// Estimated depths err, so what pictures show at the object's rim and where depths are wrong may
  /// lie outside their surface. It is within the hull: in its middle, if the ray only grazes it.
  [[nodiscard]] DistanceField::Meeting pass_through_hull(const Segment& ray) const {
    constexpr double kDeepest = 12;  // voxels
    if (!hull_) return {};
    const auto front = hull_->meet(ray.from, ray.to);
    if (front.kind != DistanceField::Meeting::Kind::hit) return {};
    const auto back = hull_->meet(ray.to, ray.from);
    const double deepest = kDeepest * hull_->voxel() / glm::distance(ray.from, ray.to);
    const double half = std::max(0.0, 1 - back.t - front.t) / 2;
    return {DistanceField::Meeting::Kind::near, front.t + std::min(half, deepest)};
  }

  /// The colour of the point at `t`, from the pictures in the nearest directions that have one.
  [[nodiscard]] std::optional<glm::vec4> blend(const Segment& ray, double t, Ask ask,
                                               Held& held) const {
    const glm::dvec3 point = ray.from + t * (ray.to - ray.from);
    const glm::dvec3 back = glm::normalize(ray.from - ray.to);
    std::array<CameraIndex::Near, kCandidates> nearest;
    const std::size_t count = index_.nearest(point, back, nearest);

    // Weights reach zero where another picture takes over, so that colours are continuous
    // (Buehler et al. 2001, section 3).
    std::array<Sight, kBlended + 1> sights;
    std::size_t seen = 0;
    for (std::size_t k = 0; k < count && seen < sights.size(); ++k) {
      const auto sight = look(point, nearest[k].camera, nearest[k].penalty, ask, held);
      if (sight.share > 0.05) sights[seen++] = sight;
    }
    if (seen == 0) return std::nullopt;
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
    if (!(weights > 0)) return std::nullopt;
    return glm::vec4(sum / weights);
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
    Picture colors = picture;
    colors.depth.clear();
    const auto image = load_picture(colors);
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
    const glm::dvec3 in_camera = picture.lens.direction(place);
    const auto hit = surface_.first_hit(sphere_, picture.eye, picture.axes * in_camera);
    return hit ? static_cast<float>(*hit * in_camera.z) : std::numeric_limits<float>::infinity();
  }

  PictureSet set_;
  Sphere sphere_;
  DistanceField surface_;
  std::optional<DistanceField> hull_;
  bool keep_background_;
  std::string provenance_;
  CameraIndex index_;
  mutable PictureCache cache_;
};

}  // namespace

Result<std::unique_ptr<Scene>> make_picture_scene(PictureSet set,
                                                  const PictureSceneOptions& options) try {
  auto found = SLF_TRY(prepare_pictures(std::move(set), options));
  const auto& hashes = found.loaded.hashes;
  XXH64_hash_t hash = XXH3_64bits(hashes.data(), hashes.size() * sizeof hashes[0]);
  const std::string cameras = transforms_json(found.set.pictures, "");
  hash = XXH3_64bits_withSeed(cameras.data(), cameras.size(), hash);
  nlohmann::json provenance{{"kind", "pictures"},
                            {"source", found.set.source},
                            {"pictures", found.set.pictures.size()},
                            {"holdout", options.holdout},
                            {"depth", found.depth},
                            {"depth_scale", options.depth_scale},
                            {"background", options.keep_background ? "keep" : "drop"},
                            {"voxels", options.voxels},
                            {"content", hash}};
  // A path need not be UTF-8.
  std::string text = provenance.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  return std::unique_ptr<Scene>(new PictureScene(std::move(found), std::move(text), options));
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
