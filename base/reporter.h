// Reporter: the progress of a long function, its callback, and the error if that asks to stop.
#pragma once

#include <string>
#include <utility>

#include "base/go_on.h"
#include "slf/error.h"
#include "slf/progress.h"

namespace slf {

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

}  // namespace slf
