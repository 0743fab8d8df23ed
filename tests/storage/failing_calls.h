// Makes the operating system refuse: the n-th call that writes, of this process, fails.
#pragma once

namespace slf::storage::testing {

/// From now on lets `calls` writing calls succeed (pwrite, write, writev, fdatasync, fsync, msync,
/// ftruncate, and mmap), then fails one, or all later ones, with `error`. -1 never fails.
void fail_after(int calls, int error, bool all_later);

/// Whether a call has failed since.
[[nodiscard]] bool has_failed();

/// Makes file systems refuse files without names, as some do.
void refuse_unnamed_files(bool refuse);

/// Makes the library of LMDB say that it is of this major version.
void pretend_lmdb(int major);

}  // namespace slf::storage::testing
