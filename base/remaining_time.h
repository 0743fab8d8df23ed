// The time that is left of a long function, from its progress so far.
#pragma once

#include <algorithm>
#include <optional>

#include "slf/progress.h"

namespace slf {

/// Counts from the last report before any work of this call: what comes before, such as the light
/// of a build, says nothing about its speed. Thread-safety: none.
class RemainingTime {
 public:
  /// Work per second, at a report `now` seconds after the beginning; 0: there was no work yet.
  double rate(const Progress& progress, double now) {
    if (progress.done <= progress.skipped) began_ = now;
    const auto fresh = static_cast<double>(progress.done - progress.skipped);
    return now > began_ ? fresh / (now - began_) : 0;
  }
  /// Seconds; nothing while the rate is unknown.
  std::optional<double> operator()(const Progress& progress, double now) {
    const double speed = rate(progress, now);
    if (!(speed > 0)) return std::nullopt;
    return static_cast<double>(std::max(progress.total, progress.done) - progress.done) / speed;
  }

 private:
  double began_ = 0;
};

}  // namespace slf
