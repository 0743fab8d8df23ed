// Progress: how far a long function is, and a way to stop it.
#pragma once

#include <cstdint>
#include <functional>

namespace slf {

struct Progress {
  std::uint64_t done = 0;  ///< work finished; of what, each function says
  std::uint64_t total = 0;
  std::uint64_t skipped = 0;  ///< of done: already there when this run began
};
/// Called from the calling thread now and then, and at the end. Returning false stops the work
/// after what is under way; what was committed stays.
using ProgressCallback = std::function<bool(const Progress&)>;

}  // namespace slf
