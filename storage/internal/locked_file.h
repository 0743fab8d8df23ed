// LockedFile: an open container, and the locks that coordinate its writer and its readers.
//
// The locks are Linux open-file-description locks on bytes of the container far beyond its end:
//   byte 2^62 - 1   locked exclusively by the writer;
//   byte 2^62 + t   locked shared by every reader of the snapshot of transaction t.
// A writer must not reuse pages that a pinned snapshot can reach. Therefore
//   - it refuses to open while a snapshot older than the current one is pinned;
//   - it reuses only pages freed before it opened, and before each commit those freed until then,
//     if no snapshot older than the last commit is pinned at that time (see tile_writer.cc).
//
// Why not LMDB's reader table? It is a memory-mapped file of mutexes beside the container. That
// file must be writable, LMDB trusts it without a check, killed processes leave their slots
// occupied, and a process cannot open a container twice. These locks need only a descriptor, which
// may be read-only and in a read-only directory, and the kernel releases them with the process.
//
// Why not a writer that never reuses pages? Once reopened, LMDB reuses pages that it freed before.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "base/file.h"
#include "slf/error.h"

namespace slf::storage::internal {

/// Thread-safety: const members from any thread.
class LockedFile {
 public:
  enum class Access { read, write };

  /// io: the file is missing, not accessible, or not a regular file.
  [[nodiscard]] static Result<LockedFile> open(const std::string& path, Access access);

  LockedFile() = default;
  /// `file` is open to read and write.
  explicit LockedFile(Descriptor file) : file_(std::move(file)) {}

  [[nodiscard]] int descriptor() const { return file_.get(); }

  /// In bytes. io: the system does not report it.
  [[nodiscard]] Result<std::uint64_t> size(const std::string& path) const;

  /// Pins the snapshot of a transaction until unpin() or destruction. Has no effect on file systems
  /// without locks: there a writer may reuse the snapshot's pages.
  void pin(std::uint64_t transaction, bool pins = true) const;
  void unpin(std::uint64_t transaction) const { pin(transaction, false); }

  /// Takes the writer's lock. failed: another writer has it. io: the file system has no locks.
  [[nodiscard]] Result<void> lock_writer(const std::string& path) const;

  /// Whether another descriptor has become the writer.
  [[nodiscard]] bool has_writer() const;

  /// Whether any reader pins a snapshot older than that of `transaction`.
  [[nodiscard]] bool pinned_before(std::uint64_t transaction) const;

 private:
  Descriptor file_;
};

}  // namespace slf::storage::internal
