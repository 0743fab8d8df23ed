// Snapshot: an open container at one transaction: file, lock, map and trees.
#pragma once

#include <memory>
#include <string>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/internal/locked_file.h"
#include "storage/internal/mapped_file.h"
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

  [[nodiscard]] ByteSpan bytes() const { return map_.bytes(); }

  /// bad_file if the file has shrunk under the map: bytes read before may have been zeros.
  [[nodiscard]] Result<void> unchanged() const override;

  /// Reads a part of bytes() from the file, bypassing the map. io: the read failed. bad_file: the
  /// file has shrunk. REQUIRES: opened with open(); `to` is as long as `part`.
  [[nodiscard]] Result<void> read(ByteSpan part, std::span<std::byte> to) const;

 private:
  explicit Snapshot(std::string path) : Trees(std::move(path)) {}

  [[nodiscard]] Result<void> shrunk() const;
  [[nodiscard]] Result<Meta> pin_current();
  [[nodiscard]] Result<void> load(const Meta& meta, const LockedFile& file);

  LockedFile file_;
  MappedFile map_;
};

}  // namespace slf::storage::internal
