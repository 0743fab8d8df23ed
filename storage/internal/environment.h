// Environment: LMDB as the writer uses it: batches of puts, each one durable or not there at all.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/internal/mapped_file.h"

struct MDB_env;
struct MDB_txn;

namespace slf::storage::internal {

/// One key and value for a named tree. Views the caller's bytes.
struct Put {
  std::string tree;
  ByteSpan key;
  ByteSpan value;
  bool append = false;  ///< the key must be above all others of the tree
};

/// Thread-safety: none.
class Environment {
 public:
  /// Opens a container for its one writer, or makes one of an empty file, with LMDB's lock file
  /// beside it. REQUIRES: the caller holds the writer's lock on `descriptor`, which is open on
  /// `path`, and has checked the pages.
  [[nodiscard]] static Result<Environment> open(const std::string& path, int descriptor);

  Environment(Environment&& other) noexcept;
  Environment& operator=(Environment&& other) noexcept;
  /// Closes, and removes the lock file unless another program uses it.
  ~Environment();

  /// The last committed transaction.
  [[nodiscard]] std::uint64_t transaction() const;

  /// Puts all, in one durable transaction; makes trees that do not exist. Grows the map as needed.
  /// io: disk full or a write error; the previous commit stays. failed, bad_file: as LMDB says.
  /// bad_file: another program has made the file shorter.
  [[nodiscard]] Result<void> put(std::span<const Put> puts);

  /// From open() on, no page that is freed is reused, so that snapshots readers hold stay whole.
  /// This lets go of the pages freed until now.
  /// REQUIRES: no reader holds a snapshot older than transaction().
  [[nodiscard]] Result<void> allow_reuse();

 private:
  Environment() = default;

  void guard();
  [[nodiscard]] Result<void> check_length() const;
  [[nodiscard]] int try_put(std::span<const Put> puts);
  [[nodiscard]] Result<void> grow();
  [[nodiscard]] Result<void> extend();
  [[nodiscard]] tl::unexpected<Error> error(int code, const char* doing) const;

  std::string path_;
  std::uint64_t map_bytes_ = 0;
  MDB_env* environment_ = nullptr;
  GuardedRange map_;           ///< LMDB's, which it reads without looking at the file's length
  MDB_txn* reader_ = nullptr;  ///< LMDB reuses no page freed after this transaction
};

}  // namespace slf::storage::internal
