// Work on several threads: parallel_for if the order does not matter, OrderedPipeline if results
// are needed in order.
#pragma once

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

namespace slf {

/// 0 means all cores.
[[nodiscard]] inline unsigned thread_count(unsigned wanted) {
  return wanted ? wanted : std::max(1u, std::thread::hardware_concurrency());
}

/// Calls work() once on each of `threads` threads, including the calling thread, and waits.
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

/// Makes items 0, 1, 2, ... on several threads and returns them in that order. Makers are never
/// more than `window` items ahead of take(), which bounds memory.
template <class T>
class OrderedPipeline {
 public:
  /// Makes one item. Each thread has its own maker, which may reuse scratch memory. Must not throw.
  using Maker = std::function<T(std::uint64_t)>;

  template <class NewMaker>
  OrderedPipeline(std::uint64_t count, unsigned threads, std::size_t window,
                  const NewMaker& new_maker)
      : count_(count), slots_(std::max<std::size_t>(window, 1)) {
    for (unsigned t = 0; t < threads; ++t)
      workers_.emplace_back([this, make = Maker(new_maker())] { work(make); });
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

  /// The next item. REQUIRES: called at most `count` times.
  T take() {
    std::unique_lock lock(mutex_);
    std::optional<T>& slot = slots_[taken_ % slots_.size()];
    changed_.wait(lock, [&] { return slot.has_value(); });
    T item = std::move(*slot);
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
      T item = make(mine);
      lock.lock();
      slots_[mine % slots_.size()] = std::move(item);
      lock.unlock();
      changed_.notify_all();
    }
  }

  const std::uint64_t count_;
  std::vector<std::optional<T>> slots_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t next_ = 0;
  std::uint64_t taken_ = 0;
  bool stop_ = false;
  std::vector<std::thread> workers_;
};

}  // namespace slf
