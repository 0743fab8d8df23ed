// Exceptions become errors here, once: on the way out of code that allocates or calls a user's
// code, where slf promises a Result.
#pragma once

#include <type_traits>
#include <utility>

#include "slf/error.h"

namespace slf {

/// The exception being handled as an error: failed, "out of memory" for std::bad_alloc, otherwise
/// what it says. REQUIRES: called in a catch block.
[[nodiscard]] Error error_of_exception() noexcept;

/// Calls f, which returns a Result or nothing; an exception comes back as an error.
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
