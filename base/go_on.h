// GoOn: a way to stop long work that has no progress to report. Internal.
#pragma once

#include <functional>

namespace slf {

/// Asked repeatedly on the calling thread. False stops the work, with an error.
using GoOn = std::function<bool()>;

}  // namespace slf
