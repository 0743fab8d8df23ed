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
#include <string>
#include <utility>

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
  GuardedRange(GuardedRange&& other) noexcept { *this = std::move(other); }
  GuardedRange& operator=(GuardedRange&& other) noexcept {
    std::swap(slot_, other.slot_);
    return *this;
  }
  ~GuardedRange();

  /// Whether an access hit a missing or unreadable page: bytes read since then may be zeros.
  [[nodiscard]] bool changed() const {
    return slot_ != nullptr && slot_->changed.load(std::memory_order_acquire);
  }

 private:
  MapSlot* slot_ = nullptr;
};

/// The cause of a fault in a map of a file that has kept its length.
inline constexpr const char* kUnreadablePage = "cannot be read: the disk reports an error";

/// Thread-safety: const members from any thread.
class MappedFile {
 public:
  /// Maps the first `bytes` bytes of `file`, which must stay open, for random access (no
  /// readahead). REQUIRES: bytes > 0. io: the kernel refused.
  [[nodiscard]] static Result<MappedFile> map(int file, std::size_t bytes, const std::string& path);

  MappedFile() = default;
  MappedFile(MappedFile&& other) noexcept { *this = std::move(other); }
  MappedFile& operator=(MappedFile&& other) noexcept {
    std::swap(file_, other.file_);
    std::swap(guard_, other.guard_);
    std::swap(bytes_, other.bytes_);
    return *this;
  }
  ~MappedFile();

  [[nodiscard]] ByteSpan bytes() const { return bytes_; }

  /// io, bad_file: GuardedRange::changed(), because the disk failed or because the file has become
  /// shorter.
  [[nodiscard]] Result<void> unchanged(const std::string& path) const;

 private:
  int file_ = -1;
  GuardedRange guard_;
  ByteSpan bytes_;
};

}  // namespace slf::storage::internal
