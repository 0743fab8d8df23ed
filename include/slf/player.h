// Player: draws the frames of a moving camera on time, from a field of any size.
//
// A frame uses the tiles that are in the cache. Where a tile is not loaded yet, it draws a coarser
// level. It waits only for tiles of level 0 that did not fit the memory at the start. A loading
// thread (the paper's second process, section 5) loads the tiles that frames lacked, and then those
// that the predicted frames will need. The cache evicts tiles that were not used recently.
//
//   PlayOptions options;
//   options.view = {default_mode(field), field.shape().finest_level};
//   auto player = Player::make(field, options);
//   for (const Camera& camera : cameras)
//     if (auto ok = player->draw(camera, picture, &report); !ok) return ok;
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>
#include <vector>

#include "slf/error.h"
#include "slf/render.h"

namespace slf {

/// Which tiles are loaded, and by which thread. The loading thread shares decoding with as many
/// others as draw.
enum class Loading {
  ahead,   ///< the loading thread: tiles that frames lacked, then those of predicted frames
  demand,  ///< the loading thread: tiles that frames lacked
  wait,    ///< no loading thread: each frame waits for all its tiles
};

[[nodiscard]] const char* name(Loading loading);
/// usage: an unknown name; the message lists the valid ones.
[[nodiscard]] Result<Loading> parse_loading(std::string_view text);

struct PlayOptions {
  RendererOptions renderer;
  ViewOptions view;  ///< `wait` follows from `loading`
  Loading loading = Loading::ahead;
  unsigned horizon = 8;  ///< frames to load ahead, if memory allows
};

struct FrameReport {
  double seconds = 0;
  std::uint64_t pixels_hit = 0;   ///< pixels whose ray crosses the sphere
  std::uint64_t pixels_full = 0;  ///< those of them drawn at the requested level
  std::uint64_t tiles = 0, misses = 0, loads = 0, load_bytes = 0;
  std::vector<std::uint64_t> level_pixels;
  /// Coarser than the requested level while storage is too slow for it.
  unsigned load_level = 0;

  static constexpr const char* kPython = "Frame";
  void describe(auto& member) const {
    member({"ms", nullptr}, 1000 * seconds, "milliseconds of drawing", R"("minimum": 0)");
    member({nullptr, "seconds"}, seconds, "of drawing");
    member("full_share", full_share(), "of the pixels at the requested level, 0 to 1");
    member("tiles", tiles, "touched, in all levels drawn");
    member("misses", misses, "of those, not loaded yet");
    member("loads", loads, "tiles loaded since the frame before");
    member("load_bytes", load_bytes, "of their payloads, and of those decoded to predict them");
    member("hit_rate", hit_rate(), "of tiles that were loaded, 0 to 1");
    member("level_pixels", level_pixels, "pixels drawn at each level");
    member("load_level", load_level, "finest level that is being loaded");
  }

  [[nodiscard]] double full_share() const {
    return pixels_hit ? static_cast<double>(pixels_full) / static_cast<double>(pixels_hit) : 1;
  }
  [[nodiscard]] double hit_rate() const {
    return tiles ? 1 - static_cast<double>(misses) / static_cast<double>(tiles) : 1;
  }
};

/// Predicts the camera `frames` frames after `now`, if it continues to turn around and approach
/// `center` as it did from `before` to `now`. After a cut, returns `now`.
[[nodiscard]] Camera predict(const glm::dvec3& center, const Camera& before, const Camera& now,
                             double frames);

/// Thread-safety: one draw() at a time.
class Player {
 public:
  /// Reads the field's tiles with a reader of its own. Unless frames wait, loads level 0 and keeps
  /// it pinned, up to a quarter of the reader's memory. usage: as Renderer::render().
  [[nodiscard]] static Result<Player> make(const Field& field, const PlayOptions& options);
  /// Shares the reader with whoever else has it, as Renderer does. Of `options.renderer`, only
  /// `threads` counts.
  [[nodiscard]] static Result<Player> make(TileReader tiles, const PlayOptions& options);
  Player(Player&&) noexcept;
  Player& operator=(Player&&) noexcept;
  /// Stops the loading thread.
  ~Player();

  /// The reader of its tiles, for others to share.
  [[nodiscard]] const TileReader& tiles() const;

  /// Draws the next frame into `image` and reuses its memory. usage: an invalid camera. bad_file: a
  /// damaged tile, in this frame or among those loaded since the previous one.
  [[nodiscard]] Result<void> draw(const Camera& camera, Image& image,
                                  FrameReport* report = nullptr);

  /// Loads, on the loading thread, what a frame from there will need. Replaces the views that the
  /// last frame let expect. Between frames of draw().
  void expect(const Camera& camera);

  /// Waits until the loading thread is idle.
  void settle();

 private:
  struct State;
  class Loader;
  explicit Player(std::unique_ptr<State> state);
  [[nodiscard]] static Result<Player> make(Renderer renderer, const PlayOptions& options);
  std::unique_ptr<State> state_;
};

}  // namespace slf
