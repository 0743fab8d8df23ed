// Times of things that are done in turns, so that what disturbs one disturbs all.
#pragma once

#include <algorithm>
#include <ctime>
#include <vector>

namespace slf::bench {

/// Seconds of a clock.
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

/// Seconds that each call took: on the wall, and of the processor in all threads.
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
