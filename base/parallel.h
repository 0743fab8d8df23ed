// Work on several threads: parallel_for if the order does not matter, OrderedPipeline if results
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

/// Makes items 0 to `count` - 1 on several threads and returns them in that order. Makers are never
/// more than `window` items ahead of take(), which bounds memory. The destructor stops after the
/// items in progress. Thread-safety: one thread calls take().
template <class T>
class OrderedPipeline {
 public:
  /// Makes one item. Each thread has its own maker, which may reuse scratch memory.
  using Maker = std::function<Result<T>(std::uint64_t)>;

  /// new_maker() returns a Maker; it is called once per thread, on the calling thread.
  template <class NewMaker>
  OrderedPipeline(std::uint64_t count, unsigned threads, std::size_t window,
                  const NewMaker& new_maker)
      : count_(count), slots_(std::max<std::size_t>(window, 1)) {
    const auto started = guarded([&] {
      for (unsigned t = 0; t < std::max(threads, 1u); ++t)
        workers_.emplace_back([this, make = Maker(new_maker())] { work(make); });
    });
    if (!started && workers_.empty()) start_error_ = started.error();  // fewer threads will do
  }
  ~OrderedPipeline() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    changed_.notify_all();
    for (auto& worker : workers_) worker.join();
  }
  OrderedPipeline(const OrderedPipeline&) = delete;
  OrderedPipeline& operator=(const OrderedPipeline&) = delete;

  /// Waits for the next item and returns it, or the error that its maker returned or threw.
  /// REQUIRES: called at most `count` times.
  [[nodiscard]] Result<T> take() {
    if (start_error_) return tl::unexpected(*start_error_);
    std::unique_lock lock(mutex_);
    std::optional<Result<T>>& slot = slots_[taken_ % slots_.size()];
    changed_.wait(lock, [&] { return slot.has_value(); });
    Result<T> item = std::move(*slot);
    slot.reset();
    ++taken_;
    lock.unlock();
    changed_.notify_all();
    return item;
  }

 private:
  void work(const Maker& make) {
    for (;;) {
      std::unique_lock lock(mutex_);
      changed_.wait(lock,
                    [&] { return stop_ || next_ == count_ || next_ < taken_ + slots_.size(); });
      if (stop_ || next_ == count_) return;
      const std::uint64_t mine = next_++;
      lock.unlock();
      Result<T> item = guarded([&] { return make(mine); });
      lock.lock();
      slots_[mine % slots_.size()] = std::move(item);
      lock.unlock();
      changed_.notify_all();
    }
  }

  const std::uint64_t count_;
  std::vector<std::optional<Result<T>>> slots_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t next_ = 0;
  std::uint64_t taken_ = 0;
  bool stop_ = false;
  std::optional<Error> start_error_;
  std::vector<std::thread> workers_;
};

}  // namespace slf
