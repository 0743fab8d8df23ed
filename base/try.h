// SLF_TRY: the value of a Result, or out of the function with its Error.
//
//   const auto field = SLF_TRY(Field::open(path));  // in a function that returns a Result
//   SLF_TRY(writer.commit());
//
// It is a statement expression of GCC and Clang. Use it as a whole statement or initializer: the
// other operands of a larger expression may or may not have been evaluated when it returns.
#pragma once

#include <utility>

#include "slf/error.h"

namespace slf::internal {

template <class T>
T value_of(Result<T>&& result) {
  if constexpr (!std::is_void_v<T>) return *std::move(result);
}

}  // namespace slf::internal

#define SLF_TRY(...)                                                       \
  __extension__({                                                          \
    auto slf_result = (__VA_ARGS__);                                       \
    if (!slf_result) return tl::unexpected(std::move(slf_result).error()); \
    ::slf::internal::value_of(std::move(slf_result));                      \
  })
