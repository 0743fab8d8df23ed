// MappedFile: a whole file mapped read-only. If the file shrinks or its disk fails, the process
// survives.
//
// An access to a mapped page that the file no longer has, or that cannot be read, raises SIGBUS.
// The first map() installs a process-wide handler that knows all live maps. For a fault in one of
// them it maps a zero page in place of the missing one, marks the map as changed, and repeats the
// access. Any other fault goes to the previous handler. Readers check changed() before they trust
// what they read.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf::storage::internal {

/// What the signal handler knows about one map. Slots are reused and never freed, so the handler
/// can walk their list at any time without a lock.
struct MapSlot {
  std::atomic<bool> used{false};
  std::atomic<std::uintptr_t> begin{0};
  std::atomic<std::uintptr_t> end{0};  ///< 0 while nothing is mapped
  std::atomic<bool> changed{false};
  MapSlot* next = nullptr;
};

/// A mapped range, ours or LMDB's, in which a missing page does not end the process.
/// Not copyable. The range must stay mapped while it is guarded.
class GuardedRange {
 public:
  GuardedRange() = default;
  explicit GuardedRange(ByteSpan mapped);

  /// Whether an access hit a missing or unreadable page: bytes read since then may be zeros.
  [[nodiscard]] bool changed() const {
    return slot_ != nullptr && slot_->changed.load(std::memory_order_acquire);
  }

 private:
  struct Release {
    void operator()(MapSlot* slot) const;
  };
  std::unique_ptr<MapSlot, Release> slot_;
};

/// The cause of a fault in a map of a file that has kept its length.
inline constexpr const char* kUnreadablePage = "cannot be read: the disk reports an error";

/// Move-only. Thread-safety: const members from any thread.
class MappedFile {
 public:
  /// Maps the first `bytes` bytes of `file`, which must stay open, for random access (no
  /// readahead). REQUIRES: bytes > 0. io: the kernel refused.
  [[nodiscard]] static Result<MappedFile> map(int file, std::size_t bytes, const std::string& path);

  MappedFile() = default;

  [[nodiscard]] ByteSpan bytes() const { return {map_.get(), map_.get_deleter().bytes}; }

  /// io, bad_file: GuardedRange::changed(), because the disk failed or because the file has become
  /// shorter.
  [[nodiscard]] Result<void> unchanged(const std::string& path) const;

 private:
  struct Unmap {
    std::size_t bytes;
    void operator()(std::byte* map) const;
  };

  int file_ = -1;
  std::unique_ptr<std::byte, Unmap> map_;
  GuardedRange guard_;  // ends before the map
};

}  // namespace slf::storage::internal
