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

/// The kind of failure.
enum class ErrorCode : int {
  usage,          ///< an argument is wrong or contradicts another
  io,             ///< the operating system or a server refused: permission, disk full
  not_found,      ///< a file does not exist
  bad_file,       ///< a file is damaged, truncated, or not what it claims to be
  failed,         ///< a correct request could not be completed at run time
  tile_missing,   ///< a tile was never built, or was dropped
  busy,           ///< another process is writing the file
  cancelled,      ///< a ProgressCallback asked to stop
  out_of_memory,  ///< there is not enough memory
  unsupported,    ///< valid, but this version cannot do it
  differs,        ///< a comparison found a difference
};

/// The name of the code, such as "not_found".
[[nodiscard]] constexpr const char* name(ErrorCode code) {
  constexpr const char* kNames[] = {"usage",         "io",           "not_found", "bad_file",
                                    "failed",        "tile_missing", "busy",      "cancelled",
                                    "out_of_memory", "unsupported",  "differs"};
  return kNames[static_cast<int>(code)];
}

/// The exit code of the `slf` command: 1 usage; 2 io, not_found; 3 bad_file; 5 unsupported;
/// 7 differs; 4 all others.
[[nodiscard]] constexpr int exit_code(ErrorCode code) {
  switch (code) {
    case ErrorCode::usage:
      return 1;
    case ErrorCode::io:
    case ErrorCode::not_found:
      return 2;
    case ErrorCode::bad_file:
      return 3;
    case ErrorCode::unsupported:
      return 5;
    case ErrorCode::differs:
      return 7;
    default:
      return 4;
  }
}

struct Error {
  ErrorCode code;
  std::string message;
  /// The member of the options that would settle it, such as "component" of VolumeOptions; null if
  /// the code and the message say all.
  const char* choice = nullptr;
};

/// The value of a call that succeeded, or the Error of one that failed.
template <class T>
using Result = tl::expected<T, Error>;

/// The streamable parts as one text.
template <class... Parts>
[[nodiscard]] std::string concat(const Parts&... parts) {
  std::ostringstream text;
  text.exceptions(std::ios::badbit);  // else it would be cut off where memory ends
  (text << ... << parts);
  return std::move(text).str();
}

/// Builds the error branch of a Result from streamable parts:
/// `return fail(ErrorCode::bad_file, path, ": expected ", a, ", found ", b);`
template <class... Parts>
[[nodiscard]] tl::unexpected<Error> fail(ErrorCode code, const Parts&... parts) {
  return tl::unexpected<Error>(Error{code, concat(parts...)});
}

/// "OF: PARTS", where `of` is what the error is about, such as a path.
template <class Of, class... Parts>
[[nodiscard]] tl::unexpected<Error> bad_file(const Of& of, const Parts&... parts) {
  return fail(ErrorCode::bad_file, of, ": ", parts...);
}
template <class Of, class... Parts>
[[nodiscard]] tl::unexpected<Error> unsupported(const Of& of, const Parts&... parts) {
  return fail(ErrorCode::unsupported, of, ": ", parts...);
}
template <class Of, class... Parts>
[[nodiscard]] tl::unexpected<Error> misuse(const Of& of, const Parts&... parts) {
  return fail(ErrorCode::usage, of, ": ", parts...);
}

/// The same error, with a place before its message:
/// `return fail_in(size.error(), path, ": its data file cannot be read: ");`
template <class... Place>
[[nodiscard]] tl::unexpected<Error> fail_in(const Error& error, const Place&... place) {
  auto within = fail(error.code, place..., error.message);
  within.value().choice = error.choice;
  return within;
}

/// fail() for what the caller can settle by this member of the options.
template <class... Parts>
[[nodiscard]] tl::unexpected<Error> fail_without(const char* choice, ErrorCode code,
                                                 const Parts&... parts) {
  auto error = fail(code, parts...);
  error.value().choice = choice;
  return error;
}

}  // namespace slf
