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
/// `seconds` of processor time. From then on, the child may compute, use its own memory, and write
/// to the descriptor `to`, and nothing else: all other system calls fail with EPERM, and memory
/// that it shares with others is gone. So map or open before what it reads. If the system refuses,
/// the child exits with kNotConfined. Where the kernel has no seccomp, or on another processor than
/// x86-64 and 64-bit ARM, system calls still work, but for writing into files and starting
/// processes without being root.
void confine_child(std::uint64_t bytes, std::uint64_t seconds, int to);

/// The exit status of such a child. For their own purposes children exit with 0 or 1.
inline constexpr int kNotConfined = 2;

/// In the parent: the error of such a child, which was to read the file `path`.
[[nodiscard]] tl::unexpected<Error> not_confined(const std::string& path);

}  // namespace slf
