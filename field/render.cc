#include "field/render.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>

#include "field/parallel.h"
#include "field/ray_block.h"

namespace slf {
namespace {

constexpr std::size_t kRayScratch = 512;  // bytes of scratch per ray of a block, about
constexpr float kFaint = 1.f / 255;       // below this opacity a depth is not worth following
constexpr int kDepthPasses = 2;

/// Index of the greatest of three.
template <class T>
int greatest(const std::array<T, 3>& w) {
  return w[0] >= w[1] ? (w[0] >= w[2] ? 0 : 2) : (w[1] >= w[2] ? 1 : 2);
}

template <class T>
void keep_greatest(std::array<T, 3>& w) {
  const int g = greatest(w);
  w = {};
  w[g] = 1;
}

/// A ray's entry side at one level: its three vertices and their weights.
struct Entry {
  std::array<EntryRow, 3> rows;
  std::array<glm::dvec3, 3> points;
  std::array<float, 3> weights;
};

Entry find_entry(const LevelGeometry& geometry, const glm::dvec3& at, bool nearest) {
  Cell cell = locate(at, geometry.entry_resolution());
  if (nearest) keep_greatest(cell.weights);
  Entry entry;
  const auto corners = cell.corners();
  for (int c = 0; c < 3; ++c) {
    entry.rows[c] = geometry.entry_row(cell.octant, corners[c]);
    entry.points[c] = direction(to_vertex(cell.octant, corners[c], geometry.entry_resolution()));
    entry.weights[c] = static_cast<float>(cell.weights[c]);
  }
  return entry;
}

void aim(Tap& tap, const LevelGeometry& geometry, const glm::dvec3& exit, bool nearest) {
  Cell cell = locate(exit, geometry.exit_resolution());
  if (nearest) keep_greatest(cell.weights);
  const auto found = geometry.exit_cell(cell);
  tap.exit_section = found.section;
  tap.columns = found.columns;
  for (int c = 0; c < 3; ++c) tap.weights[c] = static_cast<float>(cell.weights[c]);
}

/// Where the ray from a point of the unit sphere through another point leaves the sphere.
glm::dvec3 leave_sphere(const glm::dvec3& from, const glm::dvec3& through) {
  const glm::dvec3 d = through - from;
  const double length2 = glm::dot(d, d);
  if (!(length2 > 0)) return from;
  return from - 2 * glm::dot(from, d) / length2 * d;
}

/// One pixel on the way through the passes.
struct Pixel {
  Ray ray;
  Entry entry;
  glm::vec4 rgba{0};
  float t = 0;      // depth along the ray
  float alpha = 0;  // opacity the depth was weighted with
  bool missing = false;
  std::array<std::uint32_t, 3> taps{};  // where its taps are, ~0u for none
  std::array<glm::dvec3, 3> exits{};    // where each entry vertex's ray is aimed

  /// The point at depth t.
  [[nodiscard]] glm::dvec3 seen() const { return ray.enter + double{t} * (ray.leave - ray.enter); }
};

/// Draws the pixels of one block. Owned by one thread.
class BlockRenderer {
 public:
  BlockRenderer(const Field& field, TileCache& cache, const ViewOptions& options)
      : field_(field), options_(options), gatherer_(field, cache) {}

  /// Fills rgba and t of every pixel; a pixel with a missing tile is drawn from coarser levels.
  Result<void> draw(std::vector<Pixel>& pixels, std::uint64_t& fallback) {
    active_.resize(pixels.size());
    for (std::uint32_t k = 0; k < pixels.size(); ++k) active_[k] = k;
    for (unsigned level = options_.level + 1; level-- > 0 && !active_.empty();) {
      if (auto ok = draw_level(pixels, field_.geometry(level)); !ok) return ok;
      std::erase_if(active_, [&](std::uint32_t k) { return !pixels[k].missing; });
      fallback += active_.size();
    }
    return {};
  }

  std::vector<TileKey>& touched() { return gatherer_.touched(); }

 private:
  Result<void> draw_level(std::vector<Pixel>& pixels, const LevelGeometry& geometry) {
    const RenderMode mode = options_.mode;
    const bool one_entry = mode == RenderMode::nearest || mode == RenderMode::st;
    for (const std::uint32_t k : active_) {
      Pixel& pixel = pixels[k];
      pixel.entry = find_entry(geometry, pixel.ray.enter, one_entry);
      pixel.exits.fill(pixel.ray.leave);
      pixel.missing = false;
    }
    const bool follow = mode == RenderMode::depth;
    if (auto ok = pass(pixels, geometry, active_, follow || options_.with_depth); !ok) return ok;
    if (!follow) return {};
    for (int k = 1; k <= kDepthPasses; ++k) {
      followed_.clear();
      for (const std::uint32_t p : active_) {
        Pixel& pixel = pixels[p];
        if (pixel.missing || pixel.alpha <= kFaint) continue;
        const glm::dvec3 seen =
            pixel.ray.enter + double{pixel.t} * (pixel.ray.leave - pixel.ray.enter);
        for (int c = 0; c < 3; ++c) pixel.exits[c] = leave_sphere(pixel.entry.points[c], seen);
        followed_.push_back(p);
      }
      const bool more = k < kDepthPasses || options_.with_depth;
      if (auto ok = pass(pixels, geometry, followed_, more); !ok) return ok;
    }
    return {};
  }

  /// Samples each pixel's entry vertices towards their exits; sets rgba, and t where there is
  /// depth.
  Result<void> pass(std::vector<Pixel>& pixels, const LevelGeometry& geometry,
                    const std::vector<std::uint32_t>& which, bool with_depth) {
    const bool one_exit = options_.mode == RenderMode::nearest || options_.mode == RenderMode::uv;
    taps_.clear();
    for (const std::uint32_t k : which) {
      Pixel& pixel = pixels[k];
      for (int c = 0; c < 3; ++c) {
        pixel.taps[c] = ~0u;
        if (pixel.entry.weights[c] == 0) continue;
        pixel.taps[c] = static_cast<std::uint32_t>(taps_.size());
        Tap& tap = taps_.emplace_back();
        tap.entry_section = pixel.entry.rows[c].section;
        tap.row = pixel.entry.rows[c].row;
        aim(tap, geometry, pixel.exits[c], one_exit);
      }
    }
    if (auto ok = gatherer_.gather(geometry, taps_, with_depth, values_); !ok) return ok;
    for (const std::uint32_t k : which) blend(pixels[k], with_depth);
    return {};
  }

  void blend(Pixel& pixel, bool with_depth) {
    const glm::dvec3 along = pixel.ray.leave - pixel.ray.enter;
    const double length2 = glm::dot(along, along);
    glm::vec4 rgba(0);
    double t = 0;
    for (int c = 0; c < 3; ++c) {
      if (pixel.taps[c] == ~0u) continue;
      const TapValue& value = values_[pixel.taps[c]];
      pixel.missing |= value.missing;
      rgba += pixel.entry.weights[c] * value.rgba;
      if (!with_depth || value.rgba.a <= 0) continue;
      // Where the tapped ray saw something, as a position along this one.
      const glm::dvec3& from = pixel.entry.points[c];
      const glm::dvec3 seen = from + double{value.depth / value.rgba.a} * (pixel.exits[c] - from);
      t +=
          pixel.entry.weights[c] * value.rgba.a * glm::dot(seen - pixel.ray.enter, along) / length2;
    }
    pixel.rgba = rgba;
    if (!with_depth) return;
    pixel.alpha = rgba.a;
    if (rgba.a > 0) pixel.t = static_cast<float>(std::clamp(t / rgba.a, 0.0, 1.0));
  }

  const Field& field_;
  const ViewOptions& options_;
  TapGatherer gatherer_;
  std::vector<std::uint32_t> active_, followed_;
  std::vector<Tap> taps_;
  std::vector<TapValue> values_;
};

/// The pixel's ray in sphere coordinates; false where it misses the sphere.
bool cross_sphere(const Sphere& sphere, const PixelRay& pixel, Ray& ray) {
  const Chord chord = intersect(sphere, pixel.origin, pixel.direction);
  if (!chord.hit || chord.leave <= 0) return false;
  const auto at = [&](double t) {
    return glm::normalize(pixel.origin + t * pixel.direction - sphere.center);
  };
  ray.enter = at(chord.enter);
  ray.leave = at(chord.leave);
  return true;
}

void sort_unique(std::vector<TileKey>& keys) {
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
}

}  // namespace

struct Renderer::State {
  const Field& field;
  unsigned threads;
  std::uint32_t block;  // edge in pixels
  TileCache cache;
};

namespace {

struct Plan {
  unsigned threads;
  std::uint32_t block;
  std::uint64_t cache_bytes;
};

/// Adds up the payloads of the touched tiles and the pages they lie in.
Result<void> count_bytes(const Field& field, bool with_depth, ViewStatistics& statistics) {
  std::vector<std::uint64_t> pages;
  for (storage::LayerId layer = 0; layer < field.manifest().layers.size(); ++layer) {
    const bool is_depth = field.manifest().layers[layer].name == "depth";
    if (is_depth && !with_depth) continue;
    for (const TileKey& key : statistics.tiles) {
      const auto tile = field.store().find(layer, key);
      if (!tile) return tl::unexpected(tile.error());
      if (tile->state != storage::TileState::stored) continue;
      if (!is_depth) ++statistics.stored_tiles;
      statistics.compressed_bytes += tile->payload.size();
      const auto [begin, end] = field.store().range(*tile);
      for (std::uint64_t page = begin >> 12; page <= (end - 1) >> 12; ++page) pages.push_back(page);
    }
  }
  std::sort(pages.begin(), pages.end());
  statistics.map_pages =
      static_cast<std::uint64_t>(std::unique(pages.begin(), pages.end()) - pages.begin());
  return {};
}

/// Divides a budget between scratch, one tile at a time per thread, and the cache.
Plan plan_memory(const Field& field, const RendererOptions& options) {
  const std::uint64_t tile = field.shape().largest_tile() * (4 + 1);
  Plan plan;
  plan.block = options.memory >= 64ull << 20 ? 64 : options.memory >= 4ull << 20 ? 32 : 16;
  const std::uint64_t scratch = std::uint64_t{plan.block} * plan.block * kRayScratch;
  const std::uint64_t fit = options.memory / (tile + scratch);
  plan.threads =
      static_cast<unsigned>(std::clamp<std::uint64_t>(fit, 1, thread_count(options.threads)));
  const std::uint64_t used = plan.threads * scratch;
  plan.cache_bytes = options.memory > used ? options.memory - used : 0;
  return plan;
}

}  // namespace

const char* name(RenderMode mode) {
  constexpr const char* kNames[] = {"nearest", "uv", "st", "bitri", "depth"};
  return kNames[static_cast<int>(mode)];
}

Result<RenderMode> parse_render_mode(std::string_view text) {
  for (const auto mode :
       {RenderMode::nearest, RenderMode::uv, RenderMode::st, RenderMode::bitri, RenderMode::depth})
    if (text == name(mode)) return mode;
  return fail(ErrorCode::usage, "unknown mode '", text,
              "'; expected nearest, uv, st, bitri or depth");
}

RenderMode default_mode(const Field& field) {
  return field.layer("depth") ? RenderMode::depth : RenderMode::bitri;
}

Renderer::Renderer(const Field& field, const RendererOptions& options) {
  const Plan plan = plan_memory(field, options);
  state_ = std::unique_ptr<State>(
      new State{field, plan.threads, plan.block, TileCache(field, plan.cache_bytes)});
}
Renderer::~Renderer() = default;

TileCache& Renderer::cache() { return state_->cache; }

namespace {

Result<void> check_view(const Field& field, const ViewOptions& options) {
  if (options.level > field.shape().levels)
    return fail(ErrorCode::usage, field.path(), ": level ", options.level,
                ": the finest level of this field is ", field.shape().levels);
  if (options.needs_depth() && !field.layer("depth"))
    return fail(ErrorCode::usage, field.path(),
                ": has no depth layer, which mode depth needs; use --mode bitri");
  return {};
}

/// One picture under way: blocks are taken by any thread, each writes pixels of its own.
class ViewJob {
 public:
  ViewJob(const Field& field, TileCache& cache, const Camera& camera, const RayGenerator& rays,
          const ViewOptions& options, std::uint32_t edge)
      : field_(field),
        cache_(cache),
        camera_(camera),
        rays_(rays),
        options_(options),
        edge_(edge),
        across_((camera.width + edge - 1) / edge),
        blocks_(across_ * ((camera.height + edge - 1) / edge)) {
    image_.width = camera.width;
    image_.height = camera.height;
    image_.rgba.resize(std::size_t{camera.width} * camera.height);
    if (options.with_depth)
      image_.depth.assign(image_.rgba.size(), std::numeric_limits<float>::infinity());
  }

  /// Draws blocks until none are left. Called by each thread.
  void work() {
    BlockRenderer renderer(field_, cache_, options_);
    std::vector<Pixel> pixels;
    std::uint64_t fallback = 0, hit = 0;
    std::optional<Error> error;
    for (std::uint32_t block; !error && (block = next_++) < blocks_;) {
      cast_rays(block, pixels);
      hit += pixels.size();
      if (auto ok = renderer.draw(pixels, fallback); !ok) error = ok.error();
      write_pixels(pixels);
      sort_unique(renderer.touched());
    }
    const std::lock_guard lock(mutex_);
    touched_.insert(touched_.end(), renderer.touched().begin(), renderer.touched().end());
    fallback_ += fallback;
    hit_ += hit;
    if (error && !error_) error_ = error;
    if (error) next_ = blocks_;
  }

  [[nodiscard]] std::uint32_t blocks() const { return blocks_; }
  [[nodiscard]] const std::optional<Error>& error() const { return error_; }
  [[nodiscard]] Image& image() { return image_; }

  /// What the engine counted; bytes and pages are looked up by count_bytes.
  void fill(ViewStatistics& statistics) {
    sort_unique(touched_);
    statistics.tiles = std::move(touched_);
    statistics.pixels_hit = hit_;
    statistics.fallback_pixels = fallback_;
  }

 private:
  void cast_rays(std::uint32_t block, std::vector<Pixel>& pixels) const {
    const std::uint32_t x0 = block % across_ * edge_, y0 = block / across_ * edge_;
    pixels.clear();
    for (std::uint32_t y = y0; y < std::min(y0 + edge_, camera_.height); ++y)
      for (std::uint32_t x = x0; x < std::min(x0 + edge_, camera_.width); ++x) {
        Pixel pixel;
        if (!cross_sphere(field_.shape().sphere, rays_.ray(x, y), pixel.ray)) continue;
        pixel.ray.pixel = y * camera_.width + x;
        pixels.push_back(pixel);
      }
  }

  void write_pixels(const std::vector<Pixel>& pixels) {
    const Sphere& sphere = field_.shape().sphere;
    for (const Pixel& pixel : pixels) {
      image_.rgba[pixel.ray.pixel] = pixel.rgba;
      if (!options_.with_depth || pixel.rgba.a <= 0) continue;
      const glm::dvec3 seen = sphere.center + sphere.radius * pixel.seen();
      image_.depth[pixel.ray.pixel] = static_cast<float>(glm::distance(camera_.eye, seen));
    }
  }

  const Field& field_;
  TileCache& cache_;
  const Camera& camera_;
  const RayGenerator& rays_;
  const ViewOptions& options_;
  const std::uint32_t edge_, across_, blocks_;
  Image image_;
  std::atomic<std::uint32_t> next_{0};
  std::mutex mutex_;
  std::optional<Error> error_;
  std::vector<TileKey> touched_;
  std::uint64_t fallback_ = 0, hit_ = 0;
};

}  // namespace

Result<Image> Renderer::render(const Camera& camera, const ViewOptions& options,
                               ViewStatistics* statistics) {
  const auto rays = RayGenerator::make(camera);
  if (!rays) return tl::unexpected(rays.error());
  const Field& field = state_->field;
  if (auto ok = check_view(field, options); !ok) return tl::unexpected(ok.error());

  state_->cache.reset_peak();
  const std::uint64_t decodes_before = state_->cache.statistics().decodes;
  ViewJob job(field, state_->cache, camera, *rays, options, state_->block);
  on_threads(std::min(state_->threads, job.blocks()), [&] { job.work(); });
  if (job.error()) return tl::unexpected(*job.error());

  if (statistics) {
    *statistics = {};
    job.fill(*statistics);
    const CacheStatistics cache = state_->cache.statistics();
    statistics->decodes = cache.decodes - decodes_before;
    statistics->decoded_peak_bytes = cache.decoded_peak_bytes;
    if (auto ok = count_bytes(field, options.needs_depth(), *statistics); !ok)
      return tl::unexpected(ok.error());
  }
  return std::move(job.image());
}

Result<std::vector<TileKey>> crossed_pairs(const FieldShape& shape, const Camera& camera,
                                           unsigned level) {
  const auto rays = RayGenerator::make(camera);
  if (!rays) return tl::unexpected(rays.error());
  const unsigned entry_level = level + shape.entry_depth;
  std::vector<TileKey> keys;
  for (std::uint32_t y = 0; y < camera.height; ++y) {
    for (std::uint32_t x = 0; x < camera.width; ++x) {
      Ray ray;
      if (!cross_sphere(shape.sphere, rays->ray(x, y), ray)) continue;
      const TileKey key =
          tile_key({locate_section(ray.enter, entry_level), locate_section(ray.leave, level)});
      if (keys.empty() || keys.back() != key) keys.push_back(key);
    }
    if (y % 64 == 63) sort_unique(keys);
  }
  sort_unique(keys);
  return keys;
}

}  // namespace slf
