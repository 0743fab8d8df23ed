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
    begun_ = Clock::now();
    done_ = {};
    outcome_.reset();
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
  /// Since the start.
  [[nodiscard]] double seconds() const {
    return std::chrono::duration<double>(Clock::now() - begun_).count();
  }

 private:
  using Clock = std::chrono::steady_clock;

  void wait() {
    stop();
    if (thread_.joinable()) thread_.join();
  }

  mutable std::mutex mutex_;
  Progress done_;                     // guarded
  std::optional<Result<T>> outcome_;  // guarded
  Clock::time_point begun_{};
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

}  // namespace slf::page
