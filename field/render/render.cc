#include "slf/render.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <mutex>
#include <optional>
#include <span>
#include <thread>
#include <utility>

#include "base/guarded.h"
#include "base/reporter.h"
#include "base/sort_unique.h"
#include "base/try.h"
#include "field/geometry/level_geometry.h"
#include "field/render/block_renderer.h"
#include "field/render/renderer_state.h"

namespace slf {
namespace {

constexpr std::uint32_t kTakenBlocks = 16;  // blocks that a thread reserves at a time
constexpr std::size_t kRayScratch = 1280;   // approximate scratch per ray of a block, in bytes
// Scratch per sample of a predicted tile that is coded in blocks, or sample by sample.
constexpr std::size_t kBlockScratch = 28, kSampleScratch = 64;

// Predicted tiles that a thread uses at a time, with those that they are predicted from. With
// fewer, threads would evict each other's.
constexpr std::uint64_t kTilesInUse = 32;
// Tiles of a view, about. If fewer fit, threads draw next to each other and use the same ones.
constexpr std::uint64_t kTilesOfView = 512;

std::uint64_t max_tile_bytes(const FieldFile& field) {
  return field.shape().max_tile_samples() * sample_bytes(field.format());
}

std::uint64_t scratch_bytes(const FieldFile& field) {
  std::uint64_t bytes = kBlockRays * kRayScratch;
  const bool by_sample = field.codec().lossless() || is_half(field.format());
  if (field.predicts())
    bytes += field.shape().max_tile_samples() * (by_sample ? kSampleScratch : kBlockScratch);
  return bytes;
}

struct Plan {
  unsigned threads;
  std::uint64_t cache_bytes;
};

/// Divides a budget between the scratch and the tiles in use of each thread, and the cache.
Plan plan_memory(const Field& handle, const RendererOptions& options) {
  const FieldFile& field = handle.file();
  const std::uint64_t scratch = scratch_bytes(field);
  const std::uint64_t tiles = (field.predicts() ? kTilesInUse : 1) * max_tile_bytes(field) *
                              (1 + (handle.structures() ? handle.structures()->size() : 0));
  Plan plan;
  plan.threads = static_cast<unsigned>(std::clamp<std::uint64_t>(options.memory / (scratch + tiles),
                                                                 1, thread_count(options.threads)));
  const std::uint64_t used = plan.threads * scratch;
  plan.cache_bytes = options.memory > used ? options.memory - used : 0;
  return plan;
}

}  // namespace

const char* name(RenderMode mode) {
  constexpr const char* kNames[] = {"nearest", "uv", "st", "bitri", "depth"};
  return kNames[static_cast<int>(mode)];
}

Result<RenderMode> parse_render_mode(std::string_view text) try {
  for (const auto mode :
       {RenderMode::nearest, RenderMode::uv, RenderMode::st, RenderMode::bitri, RenderMode::depth})
    if (text == name(mode)) return mode;
  return fail(ErrorCode::usage, "unknown mode '", text,
              "'; expected nearest, uv, st, bitri or depth");
} catch (...) {
  return tl::unexpected(error_of_exception());
}

RenderMode default_mode(const Field& field) {
  return field.has_depth() ? RenderMode::depth : RenderMode::bitri;
}

Renderer::Renderer(const Field& field, const RendererOptions& options) {
  const Plan plan = plan_memory(field, options);
  *this = Renderer(TileReader(field, {plan.cache_bytes}), plan.threads);
}
Renderer::Renderer(TileReader tiles, unsigned threads) {
  threads = thread_count(threads);
  const std::uint64_t budget = tiles.cache().budget();
  const FieldFile& field = tiles.field().file();
  const bool ample = !field.predicts() || budget >= kTilesOfView * max_tile_bytes(field);
  state_ = std::make_unique<State>(
      State{std::move(tiles), budget / (threads + 1), ample ? threads : 1, {}});
  state_->renderers.resize(threads);
}
Renderer::Renderer(Renderer&&) noexcept = default;
Renderer& Renderer::operator=(Renderer&&) noexcept = default;
Renderer::~Renderer() {
  if (state_ && state_->tiles.cache().lost()) (void)state_.release();
}

const TileReader& Renderer::tiles() const { return state_->tiles; }

unsigned matching_level(const FieldShape& shape, const Camera& camera, RenderMode mode) {
  const double distance = glm::distance(camera.eye, shape.sphere.center) / shape.sphere.radius;
  const double pixel = 2 * std::tan(glm::radians(camera.fov) / 2) / camera.height * distance;
  return matching_level(shape, pixel, mode == RenderMode::depth);
}

Result<void> check_view(const Field& field, const ViewOptions& options) try {
  if (options.level != kMatchingLevel && options.level > field.shape().finest_level)
    return misuse(field.path(), "level ", options.level, ": the finest level of this field is ",
                  field.shape().finest_level);
  if (options.needs_depth() && !field.has_depth())
    return misuse(field.path(), "has no depth, which mode depth needs; mode bitri needs none");
  if (options.clip.size() > ViewOptions::kMaxClip)
    return fail_without("clip", ErrorCode::usage, "planes ", options.clip.size(),
                        ": expected at most ", ViewOptions::kMaxClip);
  if (!options.clip.empty() && options.mode != RenderMode::depth)
    return fail_without("clip", ErrorCode::usage, "planes need mode depth, not ",
                        name(options.mode));
  for (const auto& [point, normal] : options.clip)
    if (const double length = glm::length(normal);
        !(length > 0) || !std::isfinite(length + glm::length(point)))
      return fail_without("clip", ErrorCode::usage,
                          "expected a point and a normal, not zero and finite");
  return {};
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<void> map_tones(const Field& field, const std::optional<ToneMapping>& tone, bool display,
                       Image& image) try {
  if (tone && !field.linear())
    return fail_without("tone", ErrorCode::usage, field.path(),
                        ": tone mapping needs linear radiance: half floats, built with shadowed or "
                        "global light");
  if (!field.linear() || (!tone && !display)) return {};
  const ToneMapper map(tone.value_or(ToneMapping{}));
  for (glm::vec4& pixel : image.rgba) pixel = map(pixel);
  return {};
} catch (...) {
  return tl::unexpected(error_of_exception());
}

namespace {

ViewOptions resolved(ViewOptions options, const FieldShape& shape, const Camera& camera) {
  if (options.level == kMatchingLevel) options.level = matching_level(shape, camera, options.mode);
  return options;
}

/// Some of the rays that are traced through a view's cap, which are known without the field.
std::vector<Segment> some_cut_rays(const ViewOptions& options, const Sphere& sphere,
                                   const RayGenerator& rays, const Camera& camera) {
  const KeptSpace kept(options.clip, sphere, camera.eye);
  std::vector<Segment> some;
  const std::uint32_t step = 1 + std::max(camera.width, camera.height) / 128;
  for (std::uint32_t y = 0; y < camera.height; y += step)
    for (std::uint32_t x = 0; x < camera.width; x += step) {
      const auto [origin, direction] = rays.ray(x, y);
      const Chord chord = intersect(sphere, origin, direction);
      if (!chord.hit || chord.leave <= 0) continue;
      const auto at = [&, &from = origin, &along = direction](double t) {
        return from + t * along;
      };
      const auto unit = [&](double t) { return (at(t) - sphere.center) / sphere.radius; };
      const auto [begin, end] = kept.of(unit(chord.enter), unit(chord.leave));
      if (begin > 0 && begin < end)
        some.push_back({at(std::max(chord.enter, 0.0)), at(chord.leave)});
    }
  return some;
}

CameraBasis make_basis(const Sphere& sphere, const RayGenerator& rays, std::uint32_t width) {
  const double scale = 1 / sphere.radius;
  return {(rays.eye() - sphere.center) * scale, rays.corner() * scale, rays.across() * scale,
          rays.down() * scale, width};
}

/// The blocks of a picture, in an order in which neighbours come soon after each other: along a
/// Hilbert curve of squares. So few tiles are in use at a time, and a small cache suffices.
class BlockOrder {
 public:
  BlockOrder(std::uint32_t width, std::uint32_t height) : width_(width), height_(height) {
    const auto side = static_cast<int>(std::bit_ceil(std::max({width, height, kBlockWidth})));
    add({0, 0}, {side, 0}, {0, side});
  }
  [[nodiscard]] std::uint32_t count() const { return static_cast<std::uint32_t>(blocks_.size()); }
  [[nodiscard]] const PixelBlock& operator[](std::uint32_t n) const { return blocks_[n]; }

 private:
  /// Adds the blocks of the square with the sides `u` and `v` from its corner `at`. The curve
  /// begins at this corner and ends at `at + u`.
  void add(glm::ivec2 at, glm::ivec2 u, glm::ivec2 v) {
    const glm::uvec2 least(at + glm::min(u, 0) + glm::min(v, 0));
    const std::uint32_t side = static_cast<std::uint32_t>(std::abs(u.x) + std::abs(u.y));
    if (least.x >= width_ || least.y >= height_) return;
    if (side == kBlockWidth) {
      const std::uint32_t end_x = std::min(least.x + side, width_);
      const std::uint32_t end_y = std::min(least.y + side, height_);
      for (std::uint32_t y = least.y; y < end_y; y += kBlockHeight)
        blocks_.push_back({least.x, y, end_x, std::min(y + kBlockHeight, end_y)});
    } else {
      const glm::ivec2 p = u / 2, q = v / 2;
      add(at, q, p);
      add(at + q, p, q);
      add(at + p + q, p, q);
      add(at + u + q, -q, -p);
    }
  }

  const std::uint32_t width_, height_;
  std::vector<PixelBlock> blocks_;
};

/// One view being drawn: any thread takes blocks, each of which writes pixels of its own.
class ViewJob {
 public:
  /// `frame` as for SampleGatherer::begin(); `parts`: of the blocks, which threads begin with.
  ViewJob(std::uint32_t frame, const BlockOrder& blocks, std::size_t parts, std::size_t levels,
          Reporter& progress)
      : frame_(frame), blocks_(blocks), parts_(parts), progress_(progress), level_pixels_(levels) {
    for (std::uint32_t part = 0; part < parts; ++part) parts_[part].next = begin_of(part);
  }

  /// Draws blocks until none are left. Each thread calls it, with a number and a renderer of its
  /// own. It first draws the part with this number, so that threads share few tiles and cache
  /// lines, then helps with the other parts. If there is one part, all threads draw successive
  /// blocks of it.
  void work(std::uint32_t own, BlockRenderer& renderer, const CameraBasis& basis,
            const ViewOptions& options, const glm::dvec3& eye, Image& image) {
    std::optional<Error> error;
    renderer.begin(frame_, options, eye, image);
    for (std::uint32_t k = 0; k < parts_.size(); ++k) {
      const auto part = (own + k) % static_cast<std::uint32_t>(parts_.size());
      const std::uint32_t end = begin_of(part + 1);
      // The atomic counter waits for pending writes of pixels, so reserve several blocks at a time.
      for (std::uint32_t begin;
           !error && (begin = parts_[part].next.fetch_add(kTakenBlocks)) < end;) {
        const std::uint32_t taken = std::min(begin + kTakenBlocks, end);
        for (std::uint32_t block = begin; !error && block < taken; ++block)
          if (auto ok = renderer.draw(basis, blocks_[block]); !ok) error = ok.error();
        drawn_ += taken - begin;
        if (error || std::this_thread::get_id() != caller_) continue;
        if (auto ok = report(drawn_); !ok) error = ok.error();
      }
    }
    const std::lock_guard lock(mutex_);
    const SampleGatherer& gatherer = renderer.gatherer();
    touched_.insert(touched_.end(), gatherer.touched().begin(), gatherer.touched().end());
    misses_.insert(misses_.end(), gatherer.misses().begin(), gatherer.misses().end());
    for (std::size_t level = 0; level < level_pixels_.size(); ++level)
      level_pixels_[level] += renderer.counts().level[level];
    hit_ += renderer.counts().hit;
    if (!error) return;
    if (!error_) error_ = error;
    for (Part& part : parts_) part.next = blocks_.count();
  }

  [[nodiscard]] const std::optional<Error>& error() const { return error_; }
  /// Only for the thread that made this. `drawn`: blocks.
  [[nodiscard]] Result<void> report(std::uint32_t drawn) {
    return progress_.add(drawn - std::exchange(reported_, drawn));
  }

  /// Fills in the engine's counts.
  void fill(ViewStatistics& statistics) {
    sort_unique(misses_);
    touched_.insert(touched_.end(), misses_.begin(), misses_.end());
    sort_unique(touched_);
    statistics.tiles = std::move(touched_);
    statistics.misses = std::move(misses_);
    statistics.pixels_hit = hit_;
    statistics.level_pixels = std::move(level_pixels_);
  }

 private:
  /// Blocks from begin_of(part) to begin_of(part + 1).
  struct alignas(64) Part {
    std::atomic<std::uint32_t> next{0};
  };

  [[nodiscard]] std::uint32_t begin_of(std::uint32_t part) const {
    return static_cast<std::uint32_t>(std::uint64_t{blocks_.count()} * part / parts_.size());
  }

  std::atomic<std::uint32_t> frame_;
  const BlockOrder& blocks_;
  std::vector<Part> parts_;
  Reporter& progress_;
  std::uint32_t reported_ = 0;
  const std::thread::id caller_ = std::this_thread::get_id();
  std::atomic<std::uint32_t> drawn_{0};
  std::mutex mutex_;  // guards what follows
  std::optional<Error> error_;
  std::vector<TileKey> touched_, misses_;
  std::vector<std::uint64_t> level_pixels_;
  std::uint64_t hit_ = 0;
};

}  // namespace

Result<Image> Renderer::render(const Camera& camera, const ViewOptions& options,
                               ViewStatistics* statistics, const ProgressCallback& progress) try {
  Image image;
  SLF_TRY(render(camera, options, image, statistics, progress));
  return image;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<void> Renderer::render(const Camera& camera, const ViewOptions& options, Image& image,
                              ViewStatistics* statistics, const ProgressCallback& progress) {
  return guarded([&] { return draw(camera, options, image, statistics, progress); });
}

Result<void> Renderer::draw(const Camera& camera, const ViewOptions& requested, Image& image,
                            ViewStatistics* statistics, const ProgressCallback& progress) {
  const AtWork at_work;
  const auto rays = SLF_TRY(RayGenerator::make(camera));
  const FieldFile& field = state_->tiles.field().file();
  TileCache& cache = state_->tiles.cache();
  SLF_TRY(check_view(state_->tiles.field(), requested));
  const ViewOptions options = resolved(requested, field.shape(), camera);
  SLF_TRY(cache.check_level(options.level));

  const std::uint64_t decodes_before = cache.statistics().decodes;
  const BlockOrder blocks(camera.width, camera.height);
  Reporter reporter(progress, {0, blocks.count(), 0},
                    field.path() + ": stopped while a view was drawn");
  const bool remote = std::ranges::any_of(sources_of(state_->tiles.field()), [](const Field& one) {
    return one.file().store().is_remote();
  });
  if (remote && options.wait) {
    ViewStatistics found;
    SLF_TRY(fetch(camera, options, image, found, reporter));
    if (found.misses.empty()) {  // the last picture lacks nothing
      found.decodes = cache.statistics().decodes - decodes_before;
      if (statistics) *statistics = std::move(found);
      return reporter.add(blocks.count());
    }
  }
  if (options.cap && !options.clip.empty())
    SLF_TRY(options.cap->prepare_for(
        [&] { return some_cut_rays(options, field.shape().sphere, rays, camera); }));
  cache.reset_peak();
  const auto threads =
      static_cast<unsigned>(std::min<std::size_t>(state_->renderers.size(), blocks.count()));
  image.width = camera.width;
  image.height = camera.height;
  image.rgba.resize(std::size_t{image.width} * image.height);
  image.depth.resize(options.with_depth ? image.rgba.size() : 0);
  const CameraBasis basis = make_basis(field.shape().sphere, rays, camera.width);
  ViewJob job(cache.begin_frame(statistics != nullptr), blocks, std::min(state_->parts, threads),
              options.level + 1, reporter);
  std::atomic<std::uint32_t> workers{0};
  SLF_TRY(on_threads(threads, [&] {
    const std::uint32_t worker = workers++;
    auto& renderer = state_->renderers[worker];
    if (!renderer) renderer = std::make_unique<BlockRenderer>(field, cache, state_->pin_bytes);
    job.work(worker, *renderer, basis, options, camera.eye, image);
  }));
  if (job.error()) return tl::unexpected(*job.error());
  SLF_TRY(job.report(blocks.count()));

  if (statistics) {
    *statistics = {};
    job.fill(*statistics);
    const CacheStatistics now = cache.statistics();
    statistics->decodes = now.decodes - decodes_before;
    statistics->decoded_peak_bytes = now.decoded_peak_bytes;
  }
  return {};
}

namespace {

/// The stored tiles of level 0, unless they are large: their depths aim all rays.
std::vector<TileKey> level0_if_small(const Field& field) {
  constexpr std::uint64_t kSmall = 2 << 20;  // bytes
  std::vector<TileKey> keys;
  std::uint64_t bytes = 0;
  const auto add = [&](const storage::TileRef& tile) -> Result<void> {
    bytes += tile.payload.size();
    if (tile.state != storage::TileState::empty && field.file().shape().has(tile.key))
      keys.push_back(in_state(tile.key, field.state()));
    return {};
  };
  // An error is met again when the view is drawn.
  for (const Field& source : sources_of(field)) {
    const auto [begin, end] = keys_of(0, source.state());
    if (!source.file().store().visit(begin, end, add) || bytes > kSmall) return {};
  }
  sort_unique(keys);
  return keys;
}

}  // namespace

// Drawing finds the tiles of a view a few at a time, and over a network each few would take a round
// trip. So this function first draws pictures that do not wait, and loads all tiles that such a
// picture missed at once. Loaded depths lead to further tiles, hence several rounds.
Result<void> Renderer::fetch(const Camera& camera, ViewOptions options, Image& picture,
                             ViewStatistics& statistics, Reporter& progress) {
  constexpr int kRounds = 4;
  TileCache& cache = state_->tiles.cache();
  const auto load = [&](std::span<const TileKey> keys) -> Result<bool> {
    const FoundTiles found = cache.find(keys);
    for (const TileKey key : keys) {
      SLF_TRY(cache.load(key, found));
      SLF_TRY(progress.add(0));
    }
    return true;
  };
  options.wait = false;
  SLF_TRY(load(level0_if_small(state_->tiles.field())));
  int round = 0;
  const auto draw = [&] { return render(camera, options, picture, &statistics); };
  SLF_TRY(load_misses(statistics, draw, load, [&] { return ++round <= kRounds; }));
  return {};
}

Result<std::vector<TileKey>> crossed_pairs(const FieldShape& shape, const Camera& camera,
                                           unsigned level) try {
  const auto rays = SLF_TRY(RayGenerator::make(camera));
  const unsigned entry_level = level + shape.entry_extra_levels;
  std::vector<TileKey> keys;
  for (std::uint32_t y = 0; y < camera.height; ++y) {
    for (std::uint32_t x = 0; x < camera.width; ++x) {
      const PixelRay ray = rays.ray(x, y);
      const Chord chord = intersect(shape.sphere, ray.origin, ray.direction);
      if (!chord.hit || chord.leave <= 0) continue;
      const auto at = [&](double t) {
        return ray.origin + t * ray.direction - shape.sphere.center;
      };
      const TileKey key = tile_key(
          {locate_section(at(chord.enter), entry_level), locate_section(at(chord.leave), level)});
      if (keys.empty() || keys.back() != key) keys.push_back(key);
    }
    if (y % 64 == 63) sort_unique(keys);
  }
  sort_unique(keys);
  return keys;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
