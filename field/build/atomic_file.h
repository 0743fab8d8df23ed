// AtomicFile: a container under another name until it is whole.
#pragma once

#include <string>

#include "slf/error.h"

namespace slf {

/// A file that is to appear under `path` only when it is whole. Until then it is PATH.unfinished,
/// which goes with this object unless publish()ed. What a killed process left under that name is
/// removed by the next one that wants `path`.
/// Thread-safety: none.
class AtomicFile {
 public:
  /// The container may be created under temporary() when this returns.
  /// usage: `path` exists and is not to be replaced. failed: another process is writing it.
  /// bad_file: PATH.unfinished is no container, so not one that was left over; it stays.
  [[nodiscard]] static Result<AtomicFile> at(const std::string& path, bool replace);

  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  [[nodiscard]] const std::string& temporary() const { return temporary_; }

  /// Gives the file its name, durably. REQUIRES: the file is closed and synced.
  /// usage: `path` exists by now, and is not to be replaced. io: the system refuses.
  [[nodiscard]] Result<void> publish();

 private:
  AtomicFile(const std::string& path, bool replace)
      : path_(path), temporary_(path + ".unfinished"), replace_(replace) {}

  std::string path_, temporary_;
  bool replace_;
  bool mine_ = true;  ///< there may be something to remove
};

}  // namespace slf
