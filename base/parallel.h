// Work on several threads: parallel_for if the order does not matter, make_in_order if results
// are needed in order. An exception on any thread is returned as an error.
#pragma once

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/guarded.h"
#include "base/try.h"
#include "slf/error.h"

namespace slf {

/// The number of threads for an option `requested`: 0 means one per core.
[[nodiscard]] inline unsigned thread_count(unsigned requested) {
  return requested ? requested : std::max(1u, std::thread::hardware_concurrency());
}

/// Calls work() once on the calling thread and, concurrently, once on up to `threads` - 1 others,
/// and returns when all calls that began have returned. Each call must therefore be able to do all
/// of the work, as a loop over a shared counter is: a thread that has not begun when the calling
/// thread is done is left out. The other threads come from a pool that lives as long as the
/// process. on_threads() may be nested and called from several threads at once.
/// Returns the first exception of any call as an error (guarded.h).
[[nodiscard]] Result<void> on_threads(unsigned threads, const std::function<void()>& work);

/// Calls f(k) for each k in [0, count), in no particular order, on up to `threads` threads
/// (0: all). After an exception, which is returned as an error, no further call begins.
template <class F>
[[nodiscard]] Result<void> parallel_for(std::uint64_t count, unsigned threads, const F& f) {
  std::atomic<std::uint64_t> next{0};
  const auto max_threads =
      static_cast<unsigned>(std::clamp<std::uint64_t>(count, 1, thread_count(threads)));
  return on_threads(max_threads, [&] {
    try {
      for (std::uint64_t k; (k = next.fetch_add(1)) < count;) f(k);
    } catch (...) {
      next = count;
      throw;
    }
  });
}

/// Makes items 0 to `count` - 1 on `threads` threads and passes them in that order to use(k, item)
/// on the calling thread. new_maker() is called there once per thread, so that a maker, a function
/// from k to a Result, can reuse scratch memory. Makers are never more than `window` items ahead of
/// use(), which bounds memory. Where the system refuses threads, fewer do it, or the calling one.
/// Returns the first error of either; then no further item begins.
template <class NewMaker, class Use>
[[nodiscard]] Result<void> make_in_order(std::uint64_t count, unsigned threads, std::size_t window,
                                         const NewMaker& new_maker, const Use& use) {
  using Maker = std::invoke_result_t<NewMaker>;
  using Made = std::invoke_result_t<Maker&, std::uint64_t>;
  std::vector<std::optional<Made>> slots(std::max<std::size_t>(window, 1));
  std::mutex mutex;  // guards what follows, and the slots
  std::condition_variable changed;
  std::uint64_t next = 0, taken = 0;
  bool stop = false;
  const auto work = [&](Maker& make) {
    for (std::unique_lock lock(mutex);;) {
      changed.wait(lock, [&] { return stop || next == count || next < taken + slots.size(); });
      if (stop || next == count) return;
      const std::uint64_t mine = next++;
      lock.unlock();
      Made item = guarded([&] { return make(mine); });
      lock.lock();
      slots[mine % slots.size()] = std::move(item);
      changed.notify_all();
    }
  };
  std::optional<Maker> own;  // of the calling thread
  const auto use_all = [&]() -> Result<void> {
    for (std::uint64_t k = 0; k < count; ++k) {
      std::unique_lock lock(mutex);
      std::optional<Made>& slot = slots[k % slots.size()];
      if (own) slot = guarded([&] { return (*own)(k); });
      changed.wait(lock, [&] { return slot.has_value(); });
      Made item = *std::exchange(slot, std::nullopt);
      ++taken;
      lock.unlock();
      changed.notify_all();
      if (!item) return tl::unexpected(std::move(item).error());
      SLF_TRY(use(k, *std::move(item)));
    }
    return {};
  };
  std::vector<std::thread> workers;
  auto done = guarded([&] {
    for (unsigned t = 0; t < std::max(threads, 1u); ++t)
      workers.emplace_back([&work, make = new_maker()]() mutable { work(make); });
  });
  if (workers.empty()) done = guarded([&] { own.emplace(new_maker()); });
  if (done || !workers.empty()) done = guarded(use_all);
  {
    const std::lock_guard lock(mutex);
    stop = true;
  }
  changed.notify_all();
  for (auto& worker : workers) worker.join();
  return done;
}

}  // namespace slf
