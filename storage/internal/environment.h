// Environment: wraps LMDB for the writer. It writes batches; each is durable or has no effect.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/internal/mapped_file.h"

struct MDB_env;
struct MDB_txn;

namespace slf::storage::internal {

/// A key and a value to write to a named tree. Views the caller's bytes.
struct Put {
  std::string tree;
  ByteSpan key;           ///< empty: only creates the tree
  std::size_t bytes = 0;  ///< of the value
  /// Writes the value into its place in the transaction, which has `bytes` bytes.
  std::function<void(std::span<std::byte>)> write;
  bool append = false;  ///< fail unless the key is above all others of the tree
};

/// Not movable. Thread-safety: none.
class Environment {
 public:
  /// Opens a container for writing; turns an empty file into a container. `path` is for messages.
  /// REQUIRES: `descriptor` is open to write, and the caller holds the writer's lock on it and has
  /// checked the pages. unsupported: the library is none of LMDB 0.9, or the system has pages of
  /// another size.
  [[nodiscard]] static Result<std::unique_ptr<Environment>> open(const std::string& path,
                                                                 int descriptor);
  Environment(const Environment&) = delete;
  Environment& operator=(const Environment&) = delete;
  ~Environment();

  /// The last committed transaction.
  [[nodiscard]] std::uint64_t transaction() const;

  /// From now on put() starts writing to the disk and does not wait for it.
  void defer_sync();
  /// Waits until everything is on the disk. io: a write failed.
  [[nodiscard]] Result<void> sync();

  /// Writes all puts in one durable transaction. Creates missing trees and grows the map as needed.
  /// Call extend() next. After an error transaction() says whether the puts are committed. io: the
  /// disk is full, a write or read failed. bad_file: LMDB
  /// reports damage, or another program has truncated the file. failed: another error of LMDB.
  [[nodiscard]] Result<void> put(std::span<const Put> puts);

  /// Makes the file as long as its pages. io, bad_file: as put().
  [[nodiscard]] Result<void> extend();

  /// Allows LMDB to reuse the pages freed until now. Without this call no page freed since open()
  /// is reused, so snapshots that readers hold stay whole.
  /// REQUIRES: no reader holds a snapshot older than transaction().
  [[nodiscard]] Result<void> allow_reuse();

 private:
  explicit Environment(const std::string& path) : path_(path) {}

  void guard();
  /// The length of the file, and that of its pages.
  struct Length {
    int file;
    std::uint64_t bytes, needed;
  };
  [[nodiscard]] Result<Length> length() const;
  [[nodiscard]] Result<void> check_length() const;
  [[nodiscard]] int try_put(std::span<const Put> puts);
  [[nodiscard]] Result<void> grow();
  void start_writeback() const;
  [[nodiscard]] tl::unexpected<Error> error(int code, const char* doing) const;

  std::string path_;
  std::uint64_t map_bytes_ = 0;
  MDB_env* environment_ = nullptr;
  GuardedRange map_;           ///< LMDB's map; LMDB reads it without checking the file's length
  MDB_txn* reader_ = nullptr;  ///< LMDB does not reuse pages freed after this transaction
  bool deferred_ = false;      ///< commits do not wait for the disk
};

}  // namespace slf::storage::internal
