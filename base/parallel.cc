#include "base/parallel.h"

#include <pthread.h>

#include <list>
#include <new>
#include <system_error>

namespace slf {
namespace {

/// Threads that wait for work. Waking one costs a fraction of starting one.
class ThreadPool {
 public:
  /// Never destroyed: its threads wait for ever. After fork() they are missing in the child, and
  /// notifying a condition variable waits for those that it woke, so the child begins a new pool.
  static ThreadPool& instance() {
    static auto* const pool = new ThreadPool;
    static const int renewed = pthread_atfork(nullptr, nullptr, [] { new (pool) ThreadPool; });
    (void)renewed;
    return *pool;
  }

  Result<void> run(unsigned others, const std::function<void()>& work) {
    Job job{work, others, 0, {}};
    std::list<Job*>::iterator place;
    {
      const std::lock_guard lock(mutex_);
      place = jobs_.insert(jobs_.end(), &job);
      threads_needed_ += others;
      grow();
    }
    for (unsigned k = 0; k < others; ++k) wake_.notify_one();
    auto ok = guarded(work);
    std::unique_lock lock(mutex_);
    if (job.threads_needed > 0) {  // threads that did not wake in time are not needed
      threads_needed_ -= job.threads_needed;
      jobs_.erase(place);
    }
    done_.wait(lock, [&] { return job.running == 0; });
    if (ok && job.error) return tl::unexpected(std::move(*job.error));
    return ok;
  }

 private:
  /// One call of on_threads(). It is in jobs_ while it needs more threads.
  struct Job {
    const std::function<void()>& work;
    unsigned threads_needed;
    unsigned running;
    std::optional<Error> error;
  };

  /// Starts threads until there are as many idle ones as jobs need, or the system refuses.
  void grow() {
    try {
      for (; idle_ < threads_needed_; ++idle_) std::thread([this] { serve(); }).detach();
    } catch (const std::system_error&) {
    } catch (const std::bad_alloc&) {
    }
  }

  [[noreturn]] void serve() {
    std::unique_lock lock(mutex_);
    for (;;) {
      wake_.wait(lock, [&] { return !jobs_.empty(); });
      Job& job = *jobs_.front();
      if (--job.threads_needed == 0) jobs_.pop_front();
      --threads_needed_, --idle_, ++job.running;
      lock.unlock();
      auto ok = guarded(job.work);
      lock.lock();
      if (!ok && !job.error) job.error = std::move(ok.error());
      ++idle_;
      if (--job.running == 0) done_.notify_all();
    }
  }

  std::mutex mutex_;
  std::condition_variable wake_, done_;
  std::list<Job*> jobs_;
  unsigned threads_needed_ = 0;  // sum over jobs_
  unsigned idle_ = 0;
};

}  // namespace

Result<void> on_threads(unsigned threads, const std::function<void()>& work) {
  if (threads <= 1) return guarded(work);
  return guarded([&] { return ThreadPool::instance().run(threads - 1, work); });
}

}  // namespace slf
