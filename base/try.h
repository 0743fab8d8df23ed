// SLF_TRY: the value of a Result, or out of the function with its Error; at_place() names where.
//
//   const auto field = SLF_TRY(Field::open(path));  // in a function that returns a Result
//   SLF_TRY(writer.commit());
//   const auto size = SLF_TRY(at_place(file_size(part), path, ": part ", k));
//
// It is a statement expression of GCC and Clang. It stands alone: as a statement, as all of an
// initializer, an assigned value or an operand of `return`. Never in an argument list, in braces or
// beside an operator: when it returns, GCC 12 does not destroy the other objects of the expression.
// The test `base.try` finds such uses.
#pragma once

#include <string_view>
#include <type_traits>
#include <utility>

#include "base/join.h"
#include "slf/error.h"

namespace slf {

/// The result; if it failed, with a place before the message, "PLACE: MESSAGE". `place`: streamable
/// parts.
template <class T, class... Place>
[[nodiscard]] Result<T> at_place(Result<T> result, const Place&... place) {
  if (!result) return fail_in(result.error(), place..., ": ");
  return result;
}

/// The exception being handled, as an error: out_of_memory for std::bad_alloc, otherwise failed
/// with the text of what(); after "PLACE: ", if there is one and memory for it. REQUIRES: called in
/// a catch block. (WebAssembly has no exceptions.)
[[nodiscard]] Error error_of_exception(std::string_view place = {}) noexcept;

namespace internal {

template <class T>
T value_of(Result<T>&& result) {
  if constexpr (!std::is_void_v<T>) return *std::move(result);
}

}  // namespace internal
}  // namespace slf

// The name is another one each time, for results within results.
#define SLF_TRY_AS(result, ...)                                    \
  __extension__({                                                  \
    auto result = (__VA_ARGS__);                                   \
    if (!result) return tl::unexpected(std::move(result).error()); \
    ::slf::internal::value_of(std::move(result));                  \
  })
#define SLF_TRY_NAMED(number, ...) SLF_TRY_AS(slf_result_##number, __VA_ARGS__)
#define SLF_TRY_COUNTED(number, ...) SLF_TRY_NAMED(number, __VA_ARGS__)
#define SLF_TRY(...) SLF_TRY_COUNTED(__COUNTER__, __VA_ARGS__)
