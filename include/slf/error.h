// Error: why a call failed, as a code for the program and a message for people.
//
// Every function of slf that can fail returns Result<T>. Libraries never print and never exit. A
// message names the file, the place in it, what was expected, what was found and, if there is one,
// the cure.
#pragma once

#include <sstream>
#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace slf {

/// The kind of failure. The values are the exit codes of the `slf` command.
enum class ErrorCode : int {
  usage = 1,        ///< an argument is wrong or contradicts another
  io = 2,           ///< the operating system refused: missing, permission, disk full
  bad_file = 3,     ///< a file is damaged, truncated, or not what it claims to be
  failed = 4,       ///< a correct request could not be completed at run time
  unsupported = 5,  ///< valid, but this version cannot do it
  differs = 7,      ///< a comparison found a difference
};

struct Error {
  ErrorCode code;
  std::string message;
};

/// The value of a call that succeeded, or the Error of one that failed.
template <class T>
using Result = tl::expected<T, Error>;

/// Builds the error branch of a Result from streamable parts:
/// `return fail(ErrorCode::bad_file, path, ": expected ", a, ", found ", b);`
template <class... Parts>
[[nodiscard]] tl::unexpected<Error> fail(ErrorCode code, const Parts&... parts) {
  std::ostringstream text;
  (text << ... << parts);
  return tl::unexpected<Error>(Error{code, std::move(text).str()});
}

}  // namespace slf
