// LevelPacer: which levels the loading thread should load, so that storage keeps up with the
// camera.
//
// As in adaptive streaming, it measures how busy loading keeps the loader. If frames do not get
// what they lack for a while, storage is too slow for the whole picture, and the finest level is
// left out. If there is time to spare for several times the work, as when the camera rests, a level
// is added.
#pragma once

#include <algorithm>

namespace slf {

/// Times are in seconds. Thread-safety: one thread.
class LevelPacer {
 public:
  /// The finest level to load, of a view that wants this one.
  [[nodiscard]] unsigned level(unsigned wanted) const {
    return wanted - std::min(wanted, left_out_);
  }

  /// A plan ended, for a view that wants a level: since the one before, the loader waited for
  /// storage and decoded for `busy`, and did not for `idle`. `finished`: it loaded what the frame
  /// lacked before the next frame, or there is no memory for more.
  void add_plan(unsigned wanted, double idle, double busy, bool finished);

  /// The share of its time that the loader is busy, lately.
  [[nodiscard]] double busy_share() const {
    return busy_ + idle_ > 0 ? busy_ / (busy_ + idle_) : 0;
  }

 private:
  static constexpr double kFirstPatience = 0.5;

  unsigned left_out_ = 0;       // levels
  double busy_ = 0, idle_ = 0;  // lately: they fade
  double unfinished_ = 0;       // since a plan was finished last
  double since_change_ = 0;
  double patience_ = kFirstPatience;  // until a level is tried again
};

}  // namespace slf
