// parallel_for: the library's one way to spread independent work over threads.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

namespace slf {

/// 0 means all cores.
[[nodiscard]] inline unsigned thread_count(unsigned wanted) {
  return wanted ? wanted : std::max(1u, std::thread::hardware_concurrency());
}

/// Calls work() once on each of `threads` threads, the calling one among them, and waits.
/// work must not throw.
template <class Work>
void on_threads(unsigned threads, const Work& work) {
  std::vector<std::thread> others;
  for (unsigned t = 1; t < threads; ++t) others.emplace_back([&] { work(); });
  work();
  for (auto& other : others) other.join();
}

/// Calls f(k) for each k in [0, count), in no particular order, on up to `threads` threads
/// (0: all). f must not throw.
template <class F>
void parallel_for(std::uint64_t count, unsigned threads, const F& f) {
  std::atomic<std::uint64_t> next{0};
  const auto most =
      static_cast<unsigned>(std::clamp<std::uint64_t>(count, 1, thread_count(threads)));
  on_threads(most, [&] {
    for (std::uint64_t k; (k = next.fetch_add(1)) < count;) f(k);
  });
}

}  // namespace slf
