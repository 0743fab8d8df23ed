// Reading and replacing whole files, and renaming complete ones to their final names. Internal.
#pragma once

#include <cstdint>
#include <string>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf {

/// What becomes of a file that is already there.
enum class Existing { keep, replace };

/// The file that `path` leads to through symbolic links. It need not exist.
[[nodiscard]] std::string resolve_links(const std::string& path);

/// Whether both paths lead to one existing file, through symbolic or hard links.
[[nodiscard]] bool is_same_file(const std::string& a, const std::string& b);

/// Gives `to` the permissions of `from`, and its owner if the system permits that. If `writable`,
/// the owner may also read and write it. Does nothing if `from` does not exist.
void copy_permissions(const std::string& from, const std::string& to, bool writable);

/// Atomically renames a complete file to `to`, in the same folder. The file and its new name are
/// durable on return. If `to` is replaced, the file gets its permissions.
/// usage: `to` exists and `existing` is keep. io: names `to` and the cause; `from` then still has
/// its name, unless only the sync of the folder failed.
[[nodiscard]] Result<void> publish_file(const std::string& from, const std::string& to,
                                        Existing existing);

/// Replaces `path` by a file with `bytes`, or leaves it as it was: writes a temporary file in the
/// same folder, syncs, and renames. If `path` is a symbolic link, replaces the file it points to.
/// The new file has the permissions of the old one. io: names the path and the cause; no temporary
/// file remains.
[[nodiscard]] Result<void> write_file(const std::string& path, ByteSpan bytes);

/// The whole file. io: missing, unreadable, a folder. unsupported: longer than `limit` bytes.
[[nodiscard]] Result<Bytes> read_file(const std::string& path, std::uint64_t limit);

}  // namespace slf
