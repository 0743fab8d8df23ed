// SparseCopy: a local copy of a distant file that fills as it is read.
//
// The copy is a temporary file without a name, as long as the distant one, and mapped. Bytes that
// came stay there, so none is fetched twice; the kernel moves them out of memory as it does those
// of other files. Readers say which bytes they need before they touch them.
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "storage/internal/byte_source.h"
#include "storage/internal/mapped_file.h"
#include "storage/internal/range_set.h"
#include "storage/range_source.h"

namespace slf::storage::internal {

/// Thread-safety: const members from any thread.
class SparseCopy final : public ByteSource {
 public:
  /// io: no temporary file.
  [[nodiscard]] static Result<std::unique_ptr<SparseCopy>> make(
      std::shared_ptr<RangeSource> source);
  ~SparseCopy() override;

  /// The map; what was not fetched reads as zeros.
  [[nodiscard]] ByteSpan file() const override { return map_.bytes(); }

  /// Fetches what is not there yet of some ranges, and waits for what other threads fetch. Errors
  /// as RangeSource::fetch().
  [[nodiscard]] Result<void> fetch(std::span<const FileRange> ranges) const;

  /// Fetches a part of file(), with some more of what surrounds it: who reads single parts mostly
  /// reads on.
  [[nodiscard]] Result<void> fetch(ByteSpan part) const;

  /// These as ByteSource; bytes() returns a part of file().
  [[nodiscard]] Result<ByteSpan> bytes(std::uint64_t offset, std::uint64_t size) const override;
  void expect(std::span<const FileRange> ranges) const override { (void)fetch(ranges); }

  /// Puts bytes that came in another way. io: the disk is full.
  [[nodiscard]] Result<void> put(std::uint64_t offset, ByteSpan bytes) const;

 private:
  explicit SparseCopy(std::shared_ptr<RangeSource> source) : source_(std::move(source)) {}

  std::shared_ptr<RangeSource> source_;
  int file_ = -1;
  MappedFile map_;
  mutable std::mutex mutex_;
  mutable std::condition_variable arrived_;
  mutable RangeSet held_, coming_;
};

}  // namespace slf::storage::internal
