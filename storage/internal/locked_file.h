// LockedFile: an open container, and the locks by which its writer and readers keep out of each
// other's way.
//
// The locks are Linux open-file-description locks on bytes of the container far beyond its end:
//   byte 2^62 - 1   locked exclusively by the writer;
//   byte 2^62 + t   locked shared by every reader of the snapshot of transaction t.
// A writer must not reuse pages that a pinned snapshot can reach. It never reuses pages freed after
// the oldest of: its own opening, and the last commit at which no older pin existed (see
// tile_writer.cc); and it refuses to open while a snapshot older than the last one is pinned.
//
// Why not LMDB's reader table: it is a memory-mapped file of mutexes beside the container, which
// must be writable, is believed without a check, keeps slots of killed processes, and forbids a
// process to open a container twice. These locks need nothing but a descriptor, even a read-only
// one in a read-only directory, and the kernel drops them with the process.
// Why not a writer that never reuses anything: LMDB, reopened, reuses what its last run freed.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "slf/error.h"

namespace slf::storage::internal {

/// Whether two descriptors, or a descriptor and a path, are the same file.
[[nodiscard]] bool same_file(int a, int b);
[[nodiscard]] bool is_file(int descriptor, const std::string& path);

/// Thread-safety: const members from any thread.
class LockedFile {
 public:
  enum class Access { read, write, create };

  /// io: missing, not permitted, not a regular file.
  [[nodiscard]] static Result<LockedFile> open(const std::string& path, Access access);

  LockedFile() = default;
  LockedFile(LockedFile&& other) noexcept : file_(std::exchange(other.file_, -1)) {}
  LockedFile& operator=(LockedFile&& other) noexcept {
    std::swap(file_, other.file_);
    return *this;
  }
  ~LockedFile();

  [[nodiscard]] int descriptor() const { return file_; }

  /// io: the size cannot be had.
  [[nodiscard]] Result<std::uint64_t> size(const std::string& path) const;

  /// Pins the snapshot of a transaction until unpin() or destruction. Without effect on file
  /// systems that have no locks: there, nothing stops a writer from reusing the snapshot's pages.
  void pin(std::uint64_t transaction) const;
  void unpin(std::uint64_t transaction) const;

  /// Becomes the one writer. failed: there is one. io: the file system has no locks.
  [[nodiscard]] Result<void> lock_writer(const std::string& path) const;

  /// Whether any reader pins a snapshot older than that of `transaction`.
  [[nodiscard]] bool pinned_before(std::uint64_t transaction) const;

 private:
  int file_ = -1;
};

}  // namespace slf::storage::internal
