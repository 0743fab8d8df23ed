// Player: draws the frames of a camera's path on time, from a field of any size.
//
// A frame takes what the cache holds: where a tile is not there yet, a coarser level is drawn. It
// waits only for what did not fit of the coarsest level when playing began. Beside the frames runs
// a loading thread (the paper's second process, section 5): it brings what frames lacked, then what
// they will want if the motion goes on, and the cache drops what the path has left behind.
//
//   PlayOptions options;
//   options.view = {default_mode(field), field.shape().levels};
//   auto player = Player::make(field, options);
//   for (const Camera& camera : cameras)
//     if (auto ok = player->draw(camera, picture, &report); !ok) return ok;
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>

#include "slf/error.h"
#include "slf/render.h"

namespace slf {

/// Who loads the tiles, and when.
enum class Loading {
  ahead,   ///< the loading thread: what frames lacked, then what the motion leads to
  demand,  ///< the loading thread: what frames lacked
  wait,    ///< the frames themselves: each waits for all its tiles
};

[[nodiscard]] const char* name(Loading loading);
/// usage: unknown; the message lists the ways.
[[nodiscard]] Result<Loading> parse_loading(std::string_view text);

struct PlayOptions {
  RendererOptions renderer;
  ViewOptions view;  ///< `wait` follows from `loading`
  Loading loading = Loading::ahead;
  unsigned horizon = 8;  ///< frames to load ahead, as far as memory goes
};

struct FrameReport {
  double seconds = 0;             ///< that drawing took, on the clock
  std::uint64_t pixels_hit = 0;   ///< pixels whose ray crosses the sphere
  std::uint64_t pixels_full = 0;  ///< of them, drawn at the level asked for
  std::uint64_t tiles = 0;        ///< touched, of all levels drawn
  std::uint64_t lacking = 0;      ///< of them, not there yet
  std::uint64_t loads = 0;        ///< tiles loaded since the frame before, layers apart
  std::uint64_t load_bytes = 0;   ///< their payloads

  [[nodiscard]] double full_share() const {
    return pixels_hit ? static_cast<double>(pixels_full) / static_cast<double>(pixels_hit) : 1;
  }
  [[nodiscard]] double hit_rate() const {
    return tiles ? 1 - static_cast<double>(lacking) / static_cast<double>(tiles) : 1;
  }
};

/// Where a camera will be `frames` frames from `now`, if it keeps turning around and approaching
/// `center` as it did in the frame since `before`. After a cut, `now`.
[[nodiscard]] Camera predict(const glm::dvec3& center, const Camera& before, const Camera& now,
                             double frames);

/// Thread-safety: one draw() at a time.
class Player {
 public:
  /// Keeps a copy of the handle. Unless its frames wait, loads and keeps its coarsest level, as far
  /// as a quarter of the memory goes. usage: as Renderer::render().
  [[nodiscard]] static Result<Player> make(const Field& field, const PlayOptions& options);
  Player(Player&&) noexcept;
  Player& operator=(Player&&) noexcept;
  /// Stops the loading thread.
  ~Player();

  /// Draws the next frame into `image`, whose memory is used again. usage: a bad camera. bad_file:
  /// a damaged tile, in this frame or in what was loaded since the one before.
  [[nodiscard]] Result<void> draw(const Camera& camera, Image& image,
                                  FrameReport* report = nullptr);

  /// Waits until the loading thread has nothing left to do.
  void settle();

 private:
  struct State;
  class Loader;
  explicit Player(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace slf
