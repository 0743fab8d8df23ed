// SparseCopy: a local copy of a remote file that fills as it is read.
//
// The copy is an unnamed temporary file, as long as the remote one, and mapped. Fetched bytes stay
// in it, so none is fetched twice, and the kernel can evict them from memory like those of any
// file. Readers call fetch() for bytes before they access them.
#pragma once

#include <condition_variable>
#include <list>
#include <memory>
#include <mutex>
#include <span>

#include "base/file.h"
#include "storage/internal/byte_source.h"
#include "storage/internal/mapped_file.h"
#include "storage/internal/range_set.h"
#include "storage/range_source.h"

namespace slf::storage::internal {

/// Thread-safety: const members from any thread.
class SparseCopy final : public ByteSource {
 public:
  /// io: the temporary file cannot be created.
  [[nodiscard]] static Result<std::unique_ptr<SparseCopy>> make(
      std::shared_ptr<RangeSource> source);

  /// The map; bytes that were not fetched read as zeros.
  [[nodiscard]] ByteSpan file() const override { return map_.bytes(); }

  /// Fetches the missing bytes of some ranges, and waits for those that other threads are fetching.
  /// Errors as RangeSource::fetch().
  [[nodiscard]] Result<void> fetch(std::span<const FileRange> ranges) const;

  /// Fetches a part of file() and some bytes around it, because most readers continue with
  /// neighbouring parts.
  [[nodiscard]] Result<void> fetch(ByteSpan part) const;

  /// As in ByteSource; bytes() returns a part of file().
  [[nodiscard]] Result<ByteSpan> bytes(std::uint64_t offset, std::uint64_t size) const override;
  void expect(std::span<const FileRange> ranges) const override { (void)fetch(ranges); }

  /// Stores bytes that the caller has fetched itself. io: the disk is full.
  [[nodiscard]] Result<void> put(std::uint64_t offset, ByteSpan bytes) const;

 private:
  struct Claim;

  explicit SparseCopy(std::shared_ptr<RangeSource> source) : source_(std::move(source)) {}
  [[nodiscard]] Result<void> write(std::uint64_t offset, ByteSpan bytes) const;
  /// Fetches ranges from the source, and checks that these are of the file that was opened.
  [[nodiscard]] Result<void> load(std::span<const FileRange> ranges) const;

  std::shared_ptr<RangeSource> source_;
  Descriptor file_;
  MappedFile map_;
  mutable std::mutex mutex_;
  mutable std::condition_variable fetched_;
  mutable RangeSet present_;
  mutable std::list<RangeSet> fetching_;  ///< one of each thread that fetches
};

}  // namespace slf::storage::internal
