// Progress: how far a long function is, and a way to stop it.
#pragma once

#include <cstdint>
#include <functional>

namespace slf {

struct Progress {
  std::uint64_t done = 0;  ///< work finished, in the unit that the function's comment names
  std::uint64_t total = 0;
  std::uint64_t skipped = 0;  ///< of `done`: finished before this call
};
/// Called on the calling thread, repeatedly and at the end. If it returns false, the function
/// finishes the items that are in progress and returns the error `cancelled`.
using ProgressCallback = std::function<bool(const Progress&)>;

}  // namespace slf
