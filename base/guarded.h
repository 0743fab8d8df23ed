// Converts exceptions to errors where a function that promises a Result allocates memory or calls
// code of the user.
#pragma once

#include <type_traits>
#include <utility>

#include "base/try.h"
#include "slf/error.h"

namespace slf {

/// Calls f, which returns a Result or void. Returns its result, or its exception as an error.
template <class F>
[[nodiscard]] auto guarded(F&& f) noexcept {
  using Value = std::invoke_result_t<F>;
  using Guarded = std::conditional_t<std::is_void_v<Value>, Result<void>, Value>;
  try {
    if constexpr (std::is_void_v<Value>) {
      std::forward<F>(f)();
      return Guarded();
    } else {
      return Guarded(std::forward<F>(f)());
    }
  } catch (...) {
    return Guarded(tl::unexpected(error_of_exception()));
  }
}

}  // namespace slf
