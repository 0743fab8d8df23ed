#include "slf/player.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <glm/gtc/quaternion.hpp>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "base/guarded.h"
#include "base/parallel.h"
#include "base/try.h"
#include "field/render/level_pacer.h"
#include "field/render/renderer_state.h"

namespace slf {
namespace {

using Clock = std::chrono::steady_clock;

// Pixels along a preview's longer side. Successive previews use different ones, so that they sample
// different rays.
constexpr std::array<std::uint32_t, 4> kPreviewEdges{41, 47, 43, 53};
constexpr std::size_t kBatch = 64;  // tiles that are requested from the disk together
constexpr double kCut = 0.5;        // radians a frame; a faster turn is a cut to another place
// The loader pauses during a frame if the pause before it was at least 1/kGap of the last frame's
// time. The threshold is low, because a slow frame that competes with the loader for the CPU would
// slow down the following ones.
constexpr int kGap = 8;

Camera preview_of(Camera camera, std::uint64_t turn) {
  const auto [shorter, longer] = std::minmax(camera.width, camera.height);
  // Keep the picture's shape, even if that is a line.
  const double scale =
      std::clamp(1.0 * kPreviewEdges[turn % kPreviewEdges.size()] / longer, 1.0 / shorter, 1.0);
  const auto scaled = [&](std::uint32_t edge) {
    return std::max(1u, static_cast<std::uint32_t>(std::lround(edge * scale)));
  };
  camera.width = scaled(camera.width);
  camera.height = scaled(camera.height);
  return camera;
}

}  // namespace

const char* name(Loading loading) {
  constexpr const char* kNames[] = {"ahead", "demand", "wait"};
  return kNames[static_cast<int>(loading)];
}

Result<Loading> parse_loading(std::string_view text) try {
  for (const auto loading : {Loading::ahead, Loading::demand, Loading::wait})
    if (text == name(loading)) return loading;
  return fail(ErrorCode::usage, "unknown loading '", text, "'; expected ahead, demand or wait");
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Camera predict(const glm::dvec3& center, const Camera& before, const Camera& now, double frames) {
  const glm::dvec3 from = before.eye - center, to = now.eye - center;
  const double far = glm::length(from), near = glm::length(to);
  if (!(far > 0 && near > 0)) return now;
  const glm::dvec3 axis = glm::cross(from, to);
  const double sine = glm::length(axis) / (far * near), cosine = glm::dot(from, to) / (far * near);
  const double angle = std::atan2(sine, cosine);
  if (!(angle < kCut)) return now;

  Camera camera = now;
  const glm::dquat turn =
      sine > 0 ? glm::angleAxis(angle * frames, glm::normalize(axis)) : glm::dquat(1, 0, 0, 0);
  camera.eye = center + turn * to * std::pow(near / far, frames);
  camera.look_at = now.look_at + (now.look_at - before.look_at) * frames;
  // If `up` did not change before, it does not turn now.
  if (before.up != now.up) camera.up = turn * now.up;
  camera.fov = std::clamp(now.fov * std::pow(now.fov / before.fov, frames), now.fov / 2,
                          std::min(2 * now.fov, 170.0));
  return camera;
}

namespace {

/// Whether a camera is where it was expected: the error is at most 1/frames of its last step.
bool is_near(const Camera& camera, const Camera& expected, const Camera& before, double frames) {
  const auto apart = [](const Camera& a, const Camera& b) {
    return glm::distance(a.eye, b.eye) + glm::distance(a.look_at, b.look_at);
  };
  return apart(camera, expected) * frames <= apart(camera, before);
}

}  // namespace

/// The loading thread, which decodes on as many threads as draw. It works on the latest plan only:
/// the tiles that the last frame lacked, then those of the views to come, coarse levels first.
class Player::Loader {
 public:
  Loader(const Renderer& renderer, const ViewOptions& view)
      : cache_(renderer.state_->tiles.cache()),
        threads_(static_cast<unsigned>(renderer.state_->renderers.size())),
        view_(view),
        previewer_(renderer.state_->tiles, 1),
        thread_([this] { run(); }) {}
  ~Loader() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }

  /// Replaces the plan. `missing`: sorted keys of the tiles that the frame missed; `level`: that of
  /// the frame; `drawn`: its TileCache frame, whose tiles must stay loaded; `resting`: the frame
  /// before had the same camera.
  void plan(std::vector<TileKey> missing, std::vector<Camera> next, unsigned level,
            std::uint32_t drawn, bool resting) {
    {
      const std::lock_guard lock(mutex_);
      missing_ = std::move(missing);
      next_ = std::move(next);
      level_ = level;
      drawn_ = drawn;
      resting_ = resting;
      ++plan_;
    }
    changed_.notify_all();
  }

  void settle() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return done_ == plan_; });
  }

  /// A frame begins. `alone`: loading pauses until it ends, to leave the CPU to it. Otherwise one
  /// thread goes on loading, as long as frames are not alone.
  void begin_frame(bool alone) {
    const std::lock_guard lock(mutex_);
    paused_ = alone;
    crowded_ = !alone;
  }
  void end_frame() {
    {
      const std::lock_guard lock(mutex_);
      paused_ = false;
    }
    changed_.notify_all();
  }

  /// The finest level to load for a view of level `requested`.
  [[nodiscard]] unsigned level(unsigned requested) {
    const std::lock_guard lock(mutex_);
    return pacer_.level(requested);
  }

  /// The first error since the last call.
  [[nodiscard]] std::optional<Error> take_error() {
    const std::lock_guard lock(mutex_);
    return std::exchange(error_, std::nullopt);
  }

 private:
  void run() {
    std::unique_lock lock(mutex_);
    for (;;) {
      changed_.wait(lock, [&] { return stop_ || done_ != plan_; });
      if (stop_) return;
      const std::uint64_t plan = plan_;
      std::vector<TileKey> missing = std::move(missing_);
      const std::vector<Camera> next = std::move(next_);
      const std::uint32_t drawn = drawn_;
      LevelPacer::Plan paced{.requested = level_, .resting = resting_};
      view_.level = pacer_.level(paced.requested);
      lock.unlock();
      std::optional<AtWork> at_work(std::in_place);

      current_ = plan;
      std::erase_if(missing, [&](TileKey key) { return key.level > view_.level; });
      paced.missing = missing.size();
      auto ok = guarded([&] {
        auto room = load(missing, drawn);
        paced.finished = missing.empty() || !room || !outdated();
        for (std::size_t k = 0; room && k < next.size() && *room; ++k)
          room = load_view(next[k], drawn);
        return room;
      });

      at_work.reset();
      lock.lock();
      if (!ok && !error_) error_ = std::move(ok.error());  // a copy would take memory
      const std::chrono::duration<double> busy = std::exchange(busy_, {});
      const std::chrono::duration<double> passed =
          Clock::now() - std::exchange(paced_, Clock::now());
      paced.busy = busy.count();
      paced.idle = std::max(passed - busy, {}).count();
      pacer_.add_plan(paced);
      done_ = plan;
      changed_.notify_all();
    }
  }

  /// Whether there is a newer plan. Waits while loading is paused.
  [[nodiscard]] bool outdated() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return stop_ || !paused_; });
    return stop_ || plan_ != current_;
  }

  /// Loads tiles in batches, which the disk reads concurrently. False: there is a newer plan, or no
  /// room without evicting tiles that the next frames use.
  [[nodiscard]] Result<bool> load(std::span<const TileKey> keys, std::uint32_t drawn) {
    const auto batch = [&](std::size_t from) {
      from = std::min(from, keys.size());
      return keys.subspan(from, std::min(kBatch, keys.size() - from));
    };
    FoundTiles next = cache_.find(batch(0));
    for (std::size_t at = 0; at < keys.size(); at += kBatch) {
      const FoundTiles found = std::exchange(next, cache_.find(batch(at + kBatch)));
      if (auto ok = load_batch(batch(at), found, drawn); !ok || !*ok) return ok;
    }
    return true;
  }

  /// Loads tiles on several threads.
  [[nodiscard]] Result<bool> load_batch(std::span<const TileKey> tiles, const FoundTiles& found,
                                        std::uint32_t drawn) {
    std::atomic<std::size_t> next{0};
    std::atomic<bool> stopped{false};
    std::atomic<Clock::rep> busy{0};
    std::mutex mutex;
    std::optional<Error> error;
    const auto threads =
        static_cast<unsigned>(std::clamp<std::size_t>(tiles.size(), 1, crowded_ ? 1 : threads_));
    auto ok = on_threads(threads, [&] {
      for (std::size_t k; !stopped && (k = next++) < tiles.size();) {
        if (outdated() || !cache_.has_room(drawn)) {
          stopped = true;
          return;
        }
        const auto began = Clock::now();
        const auto pin = cache_.load(tiles[k], found);
        busy += (Clock::now() - began).count();
        if (pin) continue;
        stopped = true;
        const std::lock_guard lock(mutex);
        error = pin.error();
      }
    });
    busy_ += Clock::duration(busy) / threads;
    if (!ok) return tl::unexpected(ok.error());
    if (error) return tl::unexpected(*error);
    return !stopped;
  }

  /// Renders small previews of a view and loads the tiles that they miss. False: as load(), or a
  /// tile that was loaded was evicted again.
  [[nodiscard]] Result<bool> load_view(const Camera& camera, std::uint32_t drawn) {
    ViewStatistics statistics;
    std::uint64_t turn = current_;
    const auto draw = [&] {
      return previewer_.render(preview_of(camera, turn++), view_, preview_, &statistics);
    };
    return load_misses(
        statistics, draw, [&](std::span<const TileKey> keys) { return load(keys, drawn); },
        [&] { return !outdated(); });
  }

  TileCache& cache_;
  const unsigned threads_;
  ViewOptions view_;
  Renderer previewer_;
  Image preview_;
  std::uint64_t current_ = 0;               // the plan that is worked on
  Clock::duration busy_{};                  // loading tiles, since paced_
  Clock::time_point paced_ = Clock::now();  // end of the last plan that pacer_ knows

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<TileKey> missing_;
  std::vector<Camera> next_;
  unsigned level_ = 0;
  std::uint32_t drawn_ = 0;
  std::uint64_t plan_ = 0, done_ = 0;
  LevelPacer pacer_;
  std::optional<Error> error_;
  bool resting_ = false, stop_ = false, paused_ = false;
  std::atomic<bool> crowded_ = false;  // frames follow each other without a pause
  std::thread thread_;
};

struct Player::State {
  State(Renderer with, const PlayOptions& play_options)
      : renderer(std::move(with)), options(play_options) {
    options.view.wait = options.loading == Loading::wait;
  }
  ~State() {
    if (!working()) (void)loader.release();
  }
  /// The loader; null if there is none, or if its thread is missing in this process, a forked one.
  [[nodiscard]] Loader* working() const { return getpid() == process ? loader.get() : nullptr; }
  [[nodiscard]] TileCache& cache() const { return renderer.tiles().cache(); }
  [[nodiscard]] Result<void> draw(const Camera& camera, Image& image, FrameReport* report);

  Renderer renderer;
  PlayOptions options;
  std::vector<TileCache::Pin> coarsest;
  CacheStatistics seen;            // when the last frame was drawn
  Clock::time_point began, ended;  // of that frame
  std::optional<Camera> before;    // of that frame
  std::optional<Camera> expected;  // the prediction for the next frame
  unsigned steady = 0;             // successive frames for which the prediction was right
  const pid_t process = getpid();
  std::unique_ptr<Loader> loader;
};

Player::Player(std::unique_ptr<State> state) : state_(std::move(state)) {}
Player::Player(Player&&) noexcept = default;
Player& Player::operator=(Player&&) noexcept = default;
Player::~Player() = default;

const TileReader& Player::tiles() const { return state_->renderer.tiles(); }

Result<Player> Player::make(const Field& field, const PlayOptions& options) {
  return guarded([&] { return make(Renderer(field, options.renderer), options); });
}

Result<Player> Player::make(TileReader tiles, const PlayOptions& options) {
  return guarded(
      [&] { return make(Renderer(std::move(tiles), options.renderer.threads), options); });
}

Result<Player> Player::make(Renderer renderer, const PlayOptions& options) try {
  const Field& field = renderer.tiles().field();
  SLF_TRY(check_view(field, options.view));
  auto state = std::make_unique<State>(std::move(renderer), options);
  // Load level 0, so that frames always have a picture to fall back to.
  TileCache& cache = state->cache();
  const bool waits = options.loading == Loading::wait;
  std::uint64_t bytes = 0;
  const auto pin_tile = [&](const storage::TileRef& tile) -> Result<void> {
    const TileKey key = in_state(tile.key, cache.state());
    if (4 * bytes > cache.budget() || !field.file().shape().has(key)) return {};
    auto pin = SLF_TRY(cache.load(key));
    bytes += pin.samples().size();
    state->coarsest.push_back(std::move(pin));
    return {};
  };
  if (!waits)
    for (const Field& source : sources_of(field)) {
      const auto [begin, end] = keys_of(0, source.state());
      SLF_TRY(source.file().store().visit(begin, end, pin_tile));
    }
  state->seen = cache.statistics();
  if (!waits) state->loader = std::make_unique<Loader>(state->renderer, state->options.view);
  return Player(std::move(state));
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<void> Player::draw(const Camera& camera, Image& image, FrameReport* report) {
  return guarded([&] { return state_->draw(camera, image, report); });
}

Result<void> Player::State::draw(const Camera& camera, Image& image, FrameReport* report) {
  if (loader && !working())
    return fail(ErrorCode::usage, "the player is of the process that this one was forked from");
  const auto begin = Clock::now();
  // If there is time between frames, the loader pauses while a frame is drawn.
  const bool alone = loader && begin - ended > (ended - began) / kGap;
  if (loader) loader->begin_frame(alone);
  const std::uint32_t frame = cache().now() + 1;  // this frame's number, or a lower one
  ViewStatistics statistics;
  auto ok = renderer.render(camera, options.view, image, &statistics);
  if (loader) loader->end_frame();
  if (!ok) return ok;
  began = begin, ended = Clock::now();
  const std::chrono::duration<double> took = ended - began;
  const auto level = static_cast<unsigned>(statistics.level_pixels.size() - 1);

  if (report) {
    const CacheStatistics now = cache().statistics();
    *report = {took.count(),
               statistics.pixels_hit,
               statistics.level_pixels.back(),
               statistics.tiles.size(),
               statistics.misses.size(),
               now.decodes - seen.decodes,
               now.loaded_bytes - seen.loaded_bytes,
               statistics.level_pixels,
               0};
    report->load_level = loader ? loader->level(level) : level;
    seen = now;
  }
  if (!loader) return {};
  if (auto error = loader->take_error()) return tl::unexpected(*error);
  std::vector<Camera> next;
  if (options.loading == Loading::ahead) {
    const glm::dvec3& center = renderer.tiles().field().shape().sphere.center;
    if (!statistics.misses.empty()) next.push_back(camera);  // these may lead to further tiles
    steady =
        before && expected && is_near(camera, *expected, *before, options.horizon) ? steady + 1 : 0;
    // While the camera moves as predicted, earlier plans have covered the nearer views. Otherwise
    // plan views 1, 2, 4, … frames ahead: tiles serve several frames, so a few views suffice.
    const unsigned first = steady < options.horizon ? 1 : std::max(options.horizon, 1u);
    for (std::uint64_t k = first; before && k <= options.horizon; k *= 2) {
      const Camera ahead = predict(center, *before, camera, static_cast<double>(k));
      if (RayGenerator::make(ahead)) next.push_back(ahead);  // else it is no valid camera
    }
    if (before) expected = predict(center, *before, camera, 1);
  }
  const bool resting = before && *before == camera;
  loader->plan(std::move(statistics.misses), std::move(next), level, frame, resting);
  before = camera;
  return {};
}

void Player::expect(const Camera& camera) {
  Loader* const loader = state_->working();
  if (!loader) return;
  const unsigned finest = state_->renderer.tiles().field().shape().finest_level;
  loader->plan({}, {camera}, std::min(state_->options.view.level, finest), state_->cache().now(),
               false);
}

void Player::settle() {
  if (Loader* const loader = state_->working()) loader->settle();
}

}  // namespace slf
