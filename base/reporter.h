// Reporter: the progress of a long function, its callback, and the error if that asks to stop; and
// GoOn, a way to stop one that has no progress to report.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>
#include <utility>

#include "base/parallel.h"
#include "base/try.h"
#include "slf/error.h"
#include "slf/progress.h"

namespace slf {

/// Asked repeatedly on the calling thread. False stops the work, with an error.
using GoOn = std::function<bool()>;

/// Keeps a reference to the callback, which may be empty. Thread-safety: none.
class Reporter {
 public:
  /// `stopped`: the message of the error `cancelled`.
  Reporter(const ProgressCallback& callback, const Progress& begin, std::string stopped)
      : callback_(callback), progress_(begin), stopped_(std::move(stopped)) {}

  /// Counts finished work and calls the callback. cancelled: it asked to stop.
  [[nodiscard]] Result<void> add(std::uint64_t work) {
    progress_.done += work;
    if (go_on()) return {};
    return fail(ErrorCode::cancelled, stopped_);
  }
  /// Calls the callback. False: it asks to stop.
  [[nodiscard]] bool go_on() const { return !callback_ || callback_(progress_); }

 private:
  const ProgressCallback& callback_;
  Progress progress_;
  std::string stopped_;
};

/// parallel_for() that reports each call as work of 1, on the calling thread. cancelled: the
/// reporter's callback asked to stop.
template <class F>
[[nodiscard]] Result<void> parallel_for(std::uint64_t count, unsigned threads, Reporter& reporter,
                                        const F& f) {
  std::atomic<std::uint64_t> done{0};
  std::atomic<bool> stopped{false};
  std::uint64_t reported = 0;
  Result<void> ok;
  const auto report = [&](std::uint64_t now) {
    ok = reporter.add(now - std::exchange(reported, now));
    stopped = !ok;
  };
  SLF_TRY(parallel_for(count, threads, [&, caller = std::this_thread::get_id()](std::uint64_t k) {
    if (stopped) return;
    f(k);
    const std::uint64_t now = ++done;
    if (std::this_thread::get_id() == caller) report(now);
  }));
  if (!stopped && reported < count) report(count);
  return ok;
}

}  // namespace slf
