// Error handling of benchmarks: print the message and exit.
#pragma once

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <type_traits>
#include <utility>

#include "slf/error.h"

namespace slf::bench {

[[noreturn]] inline void stop(const std::string& message) {
  std::fprintf(stderr, "%s: %s\n", program_invocation_short_name, message.c_str());
  std::exit(static_cast<int>(ErrorCode::failed));
}

inline void require(bool good, const std::string& message) {
  if (!good) stop(message);
}

template <class T>
T expect(Result<T> result) {
  if (!result) stop(result.error().message);
  if constexpr (!std::is_void_v<T>) return std::move(*result);
}

}  // namespace slf::bench
