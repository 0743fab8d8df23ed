// Times of calls. Callers alternate what they compare, so that other load affects all alike.
#pragma once

#include <algorithm>
#include <ctime>
#include <vector>

namespace slf::bench {

/// The time of a clock, in seconds.
inline double seconds_of(clockid_t clock) {
  timespec time{};
  clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// REQUIRES: at least one value.
inline double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// The seconds of each call: by the wall clock, and of the processor on all threads.
class Times {
 public:
  template <class F>
  void run(const F& f) {
    const double wall = seconds_of(CLOCK_MONOTONIC), cpu = seconds_of(CLOCK_PROCESS_CPUTIME_ID);
    f();
    cpu_.push_back(seconds_of(CLOCK_PROCESS_CPUTIME_ID) - cpu);
    wall_.push_back(seconds_of(CLOCK_MONOTONIC) - wall);
  }
  [[nodiscard]] double median_wall() const { return median(wall_); }
  [[nodiscard]] double median_cpu() const { return median(cpu_); }

 private:
  std::vector<double> wall_, cpu_;
};

}  // namespace slf::bench
