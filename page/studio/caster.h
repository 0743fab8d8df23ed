// Caster: pictures of a recipe's scene while the recipe and the camera change, sooner rather than
// better, and better as long as nothing changes.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "slf/recipe.h"
#include "source/recipe/scenes.h"

namespace slf::page {

/// How much work a picture took; each is nearer to what `slf raycast` draws.
enum class Stage : std::uint8_t {
  none,
  moving,  ///< as large as the pace allows
  direct,  ///< the window's size; direct light, unless coarse light is complete already
  rough,   ///< light with fewer paths, at nodes four times as far apart
  coarse,  ///< the same, at nodes twice as far apart
  fine,    ///< what `slf raycast` draws
};

/// What a page wants to see.
struct Look {
  std::uint64_t serial = 0;     ///< grows from one look of a page to its next
  Sphere sphere{{}, 0};         ///< that the orbit refers to; a radius of 0: that of the scene
  std::array<double, 6> orbit;  ///< azimuth, elevation, distance, target, as in the page's address
  std::uint32_t width = 0, height = 0;
  bool moving = false;  ///< more will follow soon
};

struct Drawn {
  std::uint64_t serial = 0, revision = 0;
  Stage stage = Stage::none;
  bool last = false;    ///< none follows for this look
  bool png = false;     ///< else JPEG
  std::string bytes;    ///< empty: see `error`
  double prepared = 0;  ///< seconds that the scene took before, at any size of the picture
  Sphere sphere{};      ///< of the scene
  std::string error;
};

/// Thread-safety: any thread may call anything. One thread of its own draws, on all cores.
class Caster {
 public:
  explicit Caster(unsigned threads);
  ~Caster();
  Caster(const Caster&) = delete;
  Caster& operator=(const Caster&) = delete;

  /// Reads the volume that a recipe is of, so that errors in it are found at once. Before show().
  Result<void> read(const Recipe& recipe);
  /// Shows another recipe from now on. Returns the number of this change.
  std::uint64_t show(Recipe recipe);
  /// The first picture of a look that is better than `seen`; none if it is not there yet. An empty
  /// one, without an error, if the look is not the page's newest.
  std::optional<Drawn> picture(std::uint64_t page, const Look& look, Stage seen);
  /// A small picture under a transfer function instead of the recipe's; none: not yet.
  std::optional<Drawn> thumbnail(const std::string& transfer);
  /// Where the ray of a pixel meets what is shown, in world coordinates; none: nowhere.
  std::optional<glm::dvec3> meet(const Look& look, double x, double y);
  /// The volume that is shown, once it was read; null: none.
  std::shared_ptr<const Volume> volume();
  /// All that was read for it.
  std::shared_ptr<const recipe::Readings> readings();
  /// What readers want people to know.
  std::vector<std::string> notes();
  /// While it is paused, it draws thumbnails, and one picture of each view, of light that is there.
  void pause(bool paused);

 private:
  struct Page {
    Look look;
    Drawn drawn;
    std::uint64_t asked = 0;  ///< when, as a number that grows
    std::chrono::steady_clock::time_point polled{};

    [[nodiscard]] bool waits() const;  ///< someone may still want its pictures
  };
  struct Job {
    std::uint64_t page = 0;
    Look look;
    Stage stage = Stage::none;
    std::string transfer;  ///< of a thumbnail
  };
  using Scenes = std::map<Stage, Result<std::shared_ptr<const Scene>>>;

  void work();
  [[nodiscard]] std::optional<Job> next() const;
  Drawn draw(const Job& job);
  Result<Drawn> picture_of(const Job& job);
  void prepare();
  void keep(recipe::Readings read);
  [[nodiscard]] Stage nearest(Stage stage) const;
  Result<std::shared_ptr<const Scene>> scene(Stage stage);
  Result<std::shared_ptr<const Scene>> make(Stage stage, const std::string& transfer = {});

  const unsigned threads_;
  std::mutex mutex_;
  std::condition_variable changed_;
  Recipe recipe_;  ///< guarded, as all down to `stop_`
  std::uint64_t revision_ = 0, asked_ = 0;
  std::map<std::uint64_t, Page> pages_;
  std::map<std::string, Drawn> thumbnails_;
  std::vector<std::string> notes_;
  std::shared_ptr<const Scene> plain_;    ///< drawn last, without light that is computed on demand
  std::shared_ptr<const Volume> volume_;  ///< only changed by the thread that draws, as the next
  std::shared_ptr<const recipe::Readings> readings_ = std::make_shared<recipe::Readings>();
  bool paused_ = false, stop_ = false;
  bool prepared_ = false;  ///< whether all coarse light is there
  std::atomic<bool> cancel_ = false;

  // Of the thread that draws.
  Recipe drawn_;            ///< the recipe of `scenes_`
  std::uint64_t made_ = 0;  ///< and its number
  Scenes scenes_;
  std::string surroundings_of_;  ///< the file of `surroundings_`
  std::shared_ptr<const Image> surroundings_;
  std::shared_ptr<SharedScenes> shared_ = share_scenes();
  double pixels_ = 320 * 320;  ///< that a picture of Stage::moving may have
  std::thread thread_;
};

}  // namespace slf::page
