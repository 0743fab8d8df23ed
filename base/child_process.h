// A child process in which a library that hostile files can crash does its work. Internal.
//
//   const pid_t child = ::fork();
//   if (child == 0) { ... confine_child(...) ... write_all(pipe, ...) ... ::_exit(0); }
//
// The parent must treat what the child sends as untrusted.
#pragma once

#include <cstdint>
#include <string>

#include "slf/error.h"

namespace slf {

/// In the child: resets signal handlers that the parent installed, sends standard streams nowhere,
/// and limits, for good, what may be used from now on: `bytes` of address space more than now, and
/// `seconds` of processor time. It may neither write into files, fork, nor dump core. It is no
/// sandbox: code that takes it over may still remove files or execute another program. If the
/// system refuses, the child exits with kNotConfined.
void confine_child(std::uint64_t bytes, std::uint64_t seconds);

/// The exit status of such a child. For their own purposes children exit with 0 or 1.
inline constexpr int kNotConfined = 2;

/// In the parent: the error of such a child, which was to read the file `path`.
[[nodiscard]] tl::unexpected<Error> not_confined(const std::string& path);

}  // namespace slf
