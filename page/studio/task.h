// Task: work on a thread of its own, that can be looked at and stopped.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "base/guarded.h"
#include "slf/error.h"
#include "slf/progress.h"

namespace slf::page {

/// Thread-safety: none, but for its own thread. Stops and waits when it ends.
template <class T>
class Task {
 public:
  ~Task() { wait(); }

  /// Begins, after what it did before has stopped.
  void start(std::function<Result<T>(const ProgressCallback&)> work) {
    wait();
    stop_ = false;
    outcome_.reset();
    phase_ = nullptr;
    enter("Reading");
    thread_ = std::thread([this, work = std::move(work)] {
      auto made = guarded([&] {
        return work([this](const Progress& progress) {
          const std::lock_guard lock(mutex_);
          done_ = progress;
          return !stop_;
        });
      });
      const std::lock_guard lock(mutex_);
      outcome_ = std::move(made);
    });
  }
  void stop() { stop_ = true; }
  /// Progress is of this phase from now on. From the work's thread, too.
  void enter(const char* phase) {
    const std::lock_guard lock(mutex_);
    if (phase_ == phase) return;
    phase_ = phase;
    begun_ = Clock::now();
    done_ = {};
  }

  [[nodiscard]] bool started() const { return thread_.joinable(); }
  [[nodiscard]] bool runs() const { return started() && !outcome(); }
  /// None: it runs, or was not started.
  [[nodiscard]] std::optional<Result<T>> outcome() const {
    const std::lock_guard lock(mutex_);
    return outcome_;
  }
  [[nodiscard]] Progress progress() const {
    const std::lock_guard lock(mutex_);
    return done_;
  }
  [[nodiscard]] const char* phase() const {
    const std::lock_guard lock(mutex_);
    return phase_;
  }
  /// Since its phase began.
  [[nodiscard]] double seconds() const {
    const std::lock_guard lock(mutex_);
    return std::chrono::duration<double>(Clock::now() - begun_).count();
  }

 private:
  using Clock = std::chrono::steady_clock;

  void wait() {
    stop();
    if (thread_.joinable()) thread_.join();
  }

  mutable std::mutex mutex_;
  Progress done_;  // guarded, as all before `stop_`
  std::optional<Result<T>> outcome_;
  const char* phase_ = nullptr;  // one literal for each phase
  Clock::time_point begun_{};
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

}  // namespace slf::page
