// Snapshot: an open container at one transaction: file, lock, map and trees.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/internal/file_index.h"
#include "storage/internal/locked_file.h"
#include "storage/internal/mapped_file.h"
#include "storage/internal/sparse_copy.h"
#include "storage/internal/trees.h"

namespace slf::storage::internal {

/// Thread-safety: const members from any thread.
class Snapshot final : public Trees {
 public:
  /// Opens the current snapshot and pins it against writers. The time does not depend on the number
  /// of tiles. Errors as of TileStore::open().
  [[nodiscard]] static Result<std::unique_ptr<Snapshot>> open(const std::string& path);

  /// Opens the current snapshot for the writer, which holds the container's lock.
  [[nodiscard]] static Result<std::unique_ptr<Snapshot>> open_locked(const std::string& path,
                                                                     const LockedFile& file);

  /// Opens the snapshot of a remote file. Nothing pins it.
  [[nodiscard]] static Result<std::unique_ptr<Snapshot>> open(std::shared_ptr<RangeSource> source);

  [[nodiscard]] ByteSpan bytes() const { return copy_ ? copy_->file() : map_.bytes(); }

  /// Releases the mapped pages of bytes(). They stay in the kernel's cache and fault back in.
  void release() const;

  /// A walk over the file releases its mapped pages each time it has read this many parts. The
  /// kernel maps 64 KiB around each, so otherwise the whole file would become resident.
  static constexpr std::uint64_t kReleaseEvery = 256;

  /// Makes a part of bytes() ready to be read, if the file is remote. Errors as RangeSource.
  [[nodiscard]] Result<void> fetch(ByteSpan part) const {
    return copy_ && !part.empty() ? copy_->fetch(part) : Result<void>();
  }

  [[nodiscard]] bool is_remote() const { return copy_ != nullptr; }

  /// As TileStore::section().
  [[nodiscard]] Bytes section(std::uint32_t id) const;

  /// io, bad_file: the disk failed, or the file has shrunk, under the map: bytes read before may
  /// have been zeros.
  [[nodiscard]] Result<void> unchanged() const override;

 private:
  explicit Snapshot(std::string path) : Trees(std::move(path)) {}

  [[nodiscard]] Result<void> read_index(const Meta& meta);
  [[nodiscard]] Result<Meta> pin_current();
  [[nodiscard]] Result<void> load(const Meta& meta, const LockedFile& file);

  LockedFile file_;
  MappedFile map_;
  std::unique_ptr<SparseCopy> copy_;  // of a remote file
  std::vector<IndexSection> extras_;  // of its index: those that storage does not use
};

}  // namespace slf::storage::internal
