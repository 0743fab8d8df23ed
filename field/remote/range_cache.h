// RangeCache: a folder that keeps fetched bytes of remote files for later commands.
//
// Each entry is a file: a checksum, the identity of the remote file, and a range of its bytes. An
// entry gets its name when it is complete, so processes share a folder without locks, and one that
// is killed leaves at most a file without an entry's name. Whatever fails, the cache goes on
// without.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf {

/// Thread-safety: any thread.
class RangeCache {
 public:
  /// `identity` names one version of a remote file. `limit`: bytes of the folder. It is made if it
  /// does not exist. io: it cannot be made. usage: other users may write to it.
  [[nodiscard]] static Result<std::unique_ptr<RangeCache>> open(const std::string& folder,
                                                                std::uint64_t limit,
                                                                std::string identity);

  struct Entry {
    std::uint64_t begin = 0;
    Bytes bytes;
  };
  /// The entry with the byte `at`. If there is none, `end` becomes the begin of the next one, if
  /// that is less.
  [[nodiscard]] std::optional<Entry> read(std::uint64_t at, std::uint64_t& end);
  /// Adds an entry. Removes the least recently used ones, of all files, beyond the limit.
  void put(std::uint64_t offset, ByteSpan bytes);

 private:
  RangeCache(const std::string& folder, std::uint64_t limit, std::string identity);
  [[nodiscard]] std::string path(std::uint64_t begin, std::uint64_t end) const;
  [[nodiscard]] std::uint64_t checksum(std::uint64_t begin, ByteSpan bytes) const;
  void trim();

  const std::string folder_, identity_;
  const std::uint64_t limit_;
  std::string prefix_;  ///< of the paths of our entries
  std::mutex mutex_;
  std::map<std::uint64_t, std::uint64_t> entries_;  ///< begin → end
  std::uint64_t total_ = 0;                         ///< bytes of the folder, when last listed
  std::uint64_t added_ = 0;                         ///< bytes of ours since then
  bool writes_ = true;                              ///< false: the disk is full
};

}  // namespace slf
