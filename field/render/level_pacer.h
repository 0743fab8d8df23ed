// LevelPacer: chooses the finest level that the loading thread loads, so that storage keeps up with
// the camera.
//
// As in adaptive streaming, it measures the share of time that the loader is busy. If frames lack
// tiles for a while, and not fewer and fewer of them, storage is too slow, and the finest level is
// left out. If the loader has time for several times the work, as when the camera rests, a level is
// added. While the camera rests, no level is left out: its view may take any time to fill.
#pragma once

#include <algorithm>
#include <cstddef>

namespace slf {

/// Times are in seconds. Thread-safety: one thread.
class LevelPacer {
 public:
  /// What the loader did for a frame, since the end of its work for the frame before.
  struct Plan {
    unsigned requested = 0;   ///< level of the frame's view
    double idle = 0;          ///< time without loading
    double busy = 0;          ///< time of reading and decoding tiles
    std::size_t missing = 0;  ///< tiles that the frame lacked, up to level()
    bool finished = false;    ///< all these came before the next frame, or no memory is left
    bool resting = false;     ///< the camera did not move since the frame before
  };

  /// The finest level to load for a view of level `requested`.
  [[nodiscard]] unsigned level(unsigned requested) const {
    return requested - std::min(requested, left_out_);
  }

  void add_plan(const Plan& plan);

  /// The recent share of its time that the loader is busy.
  [[nodiscard]] double busy_share() const {
    return busy_ + idle_ > 0 ? busy_ / (busy_ + idle_) : 0;
  }

 private:
  static constexpr double kFirstPatience = 0.5;

  unsigned left_out_ = 0;       // levels
  double busy_ = 0, idle_ = 0;  // exponentially decaying sums
  double late_ = 0;             // busy time since a plan was finished or fewer tiles were missing
  std::size_t missing_ = 0;     // tiles, when late_ began
  bool in_time_ = true;         // whether a plan was finished since the last change
  double since_change_ = 0;
  double patience_ = kFirstPatience;  // time until a level is added again
};

}  // namespace slf
