// LevelPacer: chooses the finest level that the loading thread loads, so that storage keeps up with
// the camera.
//
// As in adaptive streaming, it measures the share of time that the loader is busy. If frames lack
// tiles for a while, and not fewer and fewer of them, storage is too slow, and the finest level is
// left out. If the loader has time for several times the work, as when the camera stands still, a
// level is added.
#pragma once

#include <algorithm>
#include <cstddef>

namespace slf {

/// Times are in seconds. Thread-safety: one thread.
class LevelPacer {
 public:
  /// The finest level to load for a view of level `requested`.
  [[nodiscard]] unsigned level(unsigned requested) const {
    return requested - std::min(requested, left_out_);
  }

  /// Records the end of a plan for a view of level `requested`, whose frame lacked `missing` tiles
  /// up to level(). Since the end of the previous plan, the loader loaded and decoded for `busy`
  /// seconds and was idle for `idle`. `finished`: it loaded all these tiles before the next frame,
  /// or there is no memory for more.
  void add_plan(unsigned requested, double idle, double busy, std::size_t missing, bool finished);

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
