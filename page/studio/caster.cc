#include "page/studio/caster.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "base/bytes.h"
#include "base/guarded.h"
#include "base/try.h"
#include "page/views.h"
#include "slf/image.h"
#include "source/raycast/prepared_volume.h"
#include "source/recipe/options.h"

namespace slf::page {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kPace = 0.096;  // seconds that a moving picture may take
// Its pixels: at least, and from which on it is large enough for more than direct light.
constexpr double kLeastPixels = 96 * 96, kLargePixels = 512 * 512;
constexpr double kLitCost = 1.6;  // of rays under light that is there, to direct light
constexpr std::size_t kMaxPages = 8;
constexpr std::chrono::seconds kAway(2);  // after which a page that asks for nothing is closed
constexpr std::size_t kSpareBytes = std::size_t{1} << 30;  // of volumes of earlier recipes
constexpr std::size_t kMaxThumbnails = 64;
constexpr std::uint32_t kThumbnail = 112;          // pixels along a side
constexpr int kMovingQuality = 78, kQuality = 90;  // of JPEG

Camera camera_of(const Look& look, const Sphere& own) {
  return page_camera(look.sphere.radius > 0 ? look.sphere : own, look.orbit, look.width,
                     look.height);
}

}  // namespace

bool Caster::Page::waits() const { return Clock::now() - polled < kAway; }

Caster::Caster(unsigned threads) : threads_(threads), thread_([this] { work(); }) {}

Caster::~Caster() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = cancel_ = true;
  }
  changed_.notify_all();
  thread_.join();
}

Result<void> Caster::read(const Recipe& recipe) {
  return guarded([&]() -> Result<void> {
    if (recipe.is_pictures()) SLF_TRY(read_pictures(recipe));
    if (recipe::kind_of(recipe) != recipe::kVolume) return {};
    recipe::Readings read;
    SLF_TRY(recipe::volume_of(recipe, &read));
    keep(std::move(read));
    return {};
  });
}

std::uint64_t Caster::show(Recipe recipe) {
  const std::lock_guard lock(mutex_);
  recipe_ = std::move(recipe);
  prepared_ = false;
  cancel_ = true;
  for (auto& [number, page] : pages_) page.drawn.stage = Stage::none;
  changed_.notify_all();
  return ++revision_;
}

std::optional<Drawn> Caster::picture(std::uint64_t number, const Look& look, Stage seen) {
  const std::lock_guard lock(mutex_);
  Page& page = pages_[number];
  if (!page.waits()) changed_.notify_all();
  page.polled = Clock::now();
  if (look.serial < page.look.serial) return Drawn{};
  if (look.serial > page.look.serial) {
    page.look = look;
    page.drawn = {};
    page.asked = ++asked_;
    cancel_ = true;
    if (pages_.size() > kMaxPages)
      pages_.erase(
          std::ranges::min_element(pages_, {}, [](const auto& one) { return one.second.asked; }));
    changed_.notify_all();
    return std::nullopt;
  }
  if (page.drawn.stage <= seen || page.drawn.revision != revision_) return std::nullopt;
  return page.drawn;
}

std::optional<Drawn> Caster::thumbnail(const std::string& transfer) {
  const std::lock_guard lock(mutex_);
  const auto found = thumbnails_.find(transfer);
  if (found == thumbnails_.end()) {
    if (thumbnails_.size() >= kMaxThumbnails) thumbnails_.clear();
    thumbnails_[transfer];
    changed_.notify_all();
    return std::nullopt;
  }
  if (found->second.stage == Stage::none) return std::nullopt;
  return found->second;
}

std::shared_ptr<const Volume> Caster::volume() {
  const std::lock_guard lock(mutex_);
  return volume_;
}

std::shared_ptr<const recipe::Readings> Caster::readings() {
  const std::lock_guard lock(mutex_);
  return readings_;
}

/// Keeps what a recipe reads, and of the earlier ones what takes little memory.
void Caster::keep(recipe::Readings read) {
  std::size_t spare = 0;
  for (const recipe::Reading& one : readings_->volumes) {
    const auto is_same = [&](const recipe::Reading& other) {
      return other.volume.borrowed == one.volume.borrowed;
    };
    if (std::ranges::any_of(read.volumes, is_same)) continue;
    spare += one.volume.bytes().size();
    if (spare <= kSpareBytes) read.volumes.push_back(one);
  }
  const std::lock_guard lock(mutex_);
  readings_ = std::make_shared<const recipe::Readings>(std::move(read));
}

std::vector<std::string> Caster::notes() {
  const std::lock_guard lock(mutex_);
  return notes_;
}

void Caster::pause(bool paused) {
  const std::lock_guard lock(mutex_);
  if (paused_ == paused) return;
  paused_ = paused;
  cancel_ = cancel_ || paused;
  changed_.notify_all();
}

std::optional<glm::dvec3> Caster::meet(const Look& look, double x, double y) {
  std::shared_ptr<const Scene> scene;
  Sphere sphere{};
  {
    const std::lock_guard lock(mutex_);
    scene = plain_;
    if (scene) sphere = sphere_of(recipe_, scene->bounds());
  }
  if (!scene || look.width == 0 || look.height == 0) return std::nullopt;
  const auto rays = RayGenerator::make(camera_of(look, sphere));
  if (!rays) return std::nullopt;
  const auto at = [](double share, std::uint32_t count) {
    return static_cast<std::uint32_t>(std::clamp(share, 0.0, 1.0) * (count - 1));
  };
  const PixelRay ray = rays->ray(at(x, look.width), at(y, look.height));
  const Chord chord = intersect(sphere, ray.origin, ray.direction);
  if (!chord.hit || chord.leave <= 0) return std::nullopt;
  const glm::dvec3 from = ray.origin + std::max(chord.enter, 0.0) * ray.direction,
                   to = ray.origin + chord.leave * ray.direction;
  const RaySample sample = scene->trace(from, to);
  if (sample.rgba.a <= 0) return std::nullopt;
  return glm::mix(from, to, static_cast<double>(sample.depth));
}

/// What to draw next: pages in motion first, then the poorest picture of the newest page. When
/// paused, each page gets one picture, and small ones are drawn: a browser has six connections for
/// all pages, and with all of them waiting it hears nothing else.
std::optional<Caster::Job> Caster::next() const {
  if (revision_ == 0) return std::nullopt;
  const Page* best = nullptr;
  std::uint64_t number = 0;
  Stage stage = Stage::none;
  for (const auto& [id, page] : pages_) {
    const bool current = page.drawn.revision == revision_ && page.drawn.serial == page.look.serial;
    if (page.look.serial == 0 || !page.waits()) continue;
    if (current && (paused_ || page.drawn.last)) continue;
    if (best && page.asked < best->asked) continue;
    best = &page, number = id;
    stage = page.look.moving       ? Stage::moving
            : current              ? static_cast<Stage>(static_cast<int>(page.drawn.stage) + 1)
            : paused_ && prepared_ ? Stage::coarse
                                   : Stage::direct;
  }
  if (!best || stage > Stage::rough)
    for (const auto& [transfer, drawn] : thumbnails_)
      if (drawn.stage == Stage::none) return Job{0, {}, Stage::direct, transfer};
  if (!best) return std::nullopt;
  return Job{number, best->look, stage, {}};
}

void Caster::work() {
  std::unique_lock lock(mutex_);
  while (!stop_) {
    const auto job = next();
    const auto waits = [](const auto& one) { return one.second.waits(); };
    const auto moves = [](const auto& one) { return one.second.waits() && one.second.look.moving; };
    const bool prepares = !job && !paused_ && revision_ > 0 && !prepared_ &&
                          std::ranges::none_of(pages_, moves) && std::ranges::any_of(pages_, waits);
    if (!job && !prepares) {
      changed_.wait(lock);
      continue;
    }
    cancel_ = false;
    if (made_ != revision_) {
      scenes_.clear();
      drawn_ = recipe_;
      made_ = revision_;
    }
    lock.unlock();
    Drawn drawn;
    if (job)
      drawn = draw(*job);
    else
      prepare();
    lock.lock();
    // What was interrupted is drawn again, unless something newer is wanted.
    if (!job || drawn.revision != revision_ || (drawn.bytes.empty() && drawn.error.empty()))
      continue;
    if (job->page == 0) {
      thumbnails_[job->transfer] = std::move(drawn);
    } else if (const auto found = pages_.find(job->page);
               found != pages_.end() && found->second.look.serial == drawn.serial) {
      found->second.drawn = std::move(drawn);
    }
  }
}

Drawn Caster::draw(const Job& job) {
  auto drawn = guarded([&] { return picture_of(job); });
  if (!drawn) {
    Drawn failed;
    if (drawn.error().code != ErrorCode::cancelled) failed.error = drawn.error().message;
    failed.stage = Stage::fine;
    failed.last = true;
    drawn = std::move(failed);
  }
  drawn->serial = job.look.serial;
  drawn->revision = made_;
  return std::move(*drawn);
}

Result<Drawn> Caster::picture_of(const Job& job) {
  const bool small = !job.transfer.empty(), moving = job.stage == Stage::moving;
  // What comes first has coarse light if that is complete and leaves pictures in motion large.
  const double asked = static_cast<double>(job.look.width) * job.look.height;
  const bool large = pixels_ >= kLitCost * std::min(asked, kLargePixels);
  const bool lit = prepared_ && (large || job.stage > Stage::direct);
  const Stage stage = nearest(std::max(job.stage, lit ? Stage::coarse : Stage::direct));
  const auto start = Clock::now();
  const auto shown = SLF_TRY(small ? make(Stage::direct, job.transfer) : scene(stage));
  const Sphere sphere = sphere_of(drawn_, shown->bounds());
  Look look = job.look;
  if (small) look = {1, {{}, 0}, {30, 20, 3, 0, 0, 0}, kThumbnail, kThumbnail, false};
  const auto begin = Clock::now();
  Drawn drawn;
  drawn.prepared = std::chrono::duration<double>(begin - start).count();
  const double cost = stage > Stage::direct && moving ? kLitCost : 1;
  const double pixels = pixels_ / cost * std::clamp(1 - drawn.prepared / kPace, 0.25, 1.0);
  const double shrink = moving ? std::sqrt(std::min(1.0, pixels / asked)) : 1;
  look.width = std::max(1u, static_cast<std::uint32_t>(look.width * shrink));
  look.height = std::max(1u, static_cast<std::uint32_t>(look.height * shrink));
  const Image image = SLF_TRY(trace_view(*shown, sphere, camera_of(look, sphere), threads_,
                                         [&](const Progress&) { return moving || !cancel_; }));
  if (moving) {
    const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    const double traced = cost * look.width * look.height;
    pixels_ =
        std::max(kLeastPixels, pixels_ * std::clamp(traced / pixels_ * kPace / seconds, 0.5, 1.5));
  }
  drawn.stage = moving ? Stage::moving : stage;
  drawn.last = moving || stage == Stage::fine;
  drawn.png = drawn.stage == Stage::fine;
  drawn.sphere = sphere;
  const auto bytes = SLF_TRY(encode_image(drawn.png ? "view.png" : "view.jpg", image,
                                          {.jpeg_quality = moving ? kMovingQuality : kQuality}));
  drawn.bytes = std::string(chars_of(bytes));
  return drawn;
}

/// Computes all coarse light, so that it is there while the camera moves.
void Caster::prepare() {
  const auto done = guarded([&]() -> Result<void> {
    const auto coarse = SLF_TRY(scene(nearest(Stage::coarse)));
    return coarse->prepare();
  });
  const std::lock_guard lock(mutex_);
  if (done || done.error().code != ErrorCode::cancelled) prepared_ = made_ == revision_;
}

/// The stage that draws the same, of those that this recipe has.
Stage Caster::nearest(Stage stage) const {
  const auto kind = recipe::kind_of(drawn_);
  const bool lit = drawn_.lighting != Lighting::direct && !drawn_.ambient && drawn_.raycast.shade &&
                   drawn_.raycast.projection == Projection::none &&
                   (kind == recipe::kVolume || kind == recipe::kMesh);
  return !lit || (stage > Stage::direct && kind != recipe::kVolume) ? Stage::fine : stage;
}

/// REQUIRES: nearest(stage) == stage.
Result<std::shared_ptr<const Scene>> Caster::scene(Stage stage) {
  auto found = scenes_.find(stage);
  if (found == scenes_.end()) found = scenes_.emplace(stage, make(stage)).first;
  if (found->second && (stage == Stage::direct || nearest(Stage::direct) == stage)) {
    const std::lock_guard lock(mutex_);
    plain_ = *found->second;
  }
  return found->second;
}

Result<std::shared_ptr<const Scene>> Caster::make(Stage stage, const std::string& transfer) {
  Recipe recipe = drawn_;
  std::vector<std::string> notes;
  recipe.on_note = [&](const std::string& note, const char*) { notes.push_back(note); };
  recipe.light_volume.threads = threads_;
  recipe.light_volume.progress = [this](const Progress&) { return !cancel_; };
  recipe.read = readings_;
  if (!transfer.empty()) {
    recipe.transfer = transfer;
    recipe.range.reset();
  }
  LightOptions& light = recipe.raycast.lighting;
  if (stage == Stage::direct) {
    recipe.lighting = Lighting::direct;
    recipe.environment.clear();
  } else if (!recipe.environment.empty()) {
    if (surroundings_of_ != recipe.environment) {
      surroundings_ = std::make_shared<const Image>(SLF_TRY(read_image(recipe.environment)));
      surroundings_of_ = recipe.environment;
    }
    light.environment = surroundings_;
    recipe.environment.clear();
  }
  if (stage == Stage::rough || stage == Stage::coarse) {
    light.spacing = std::min(16.0, (stage == Stage::rough ? 4 : 2) * light.spacing);
    light.samples = std::max(1u, light.samples / 4);
  }
  recipe::Readings read{{}, readings_->unit};
  if (recipe::kind_of(recipe) == recipe::kVolume) {
    const Volume volume = SLF_TRY(guarded([&] { return recipe::volume_of(recipe, &read); }));
    if (!volume_ || volume_->borrowed != volume.borrowed) {  // else it is the same
      shared_ = share_scenes();
      const std::lock_guard lock(mutex_);
      volume_ = std::make_shared<const Volume>(volume);
    }
  }
  recipe.raycast.shared = shared_;
  std::shared_ptr<const Scene> made =
      SLF_TRY(guarded([&] { return recipe::scene_of(recipe, &read); }));
  shared_->lit.clear();  // no scene that follows shows other labels in the same light
  keep(std::move(read));
  const std::lock_guard lock(mutex_);
  if (transfer.empty()) notes_ = std::move(notes);
  return made;
}

}  // namespace slf::page
