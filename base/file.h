// Files as a whole: read, replaced, and given their final names. Internal.
#pragma once

#include <cstdint>
#include <string>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf {

/// What becomes of a file that is already there.
enum class Existing { keep, replace };

/// The file that `path` leads to through symbolic links. It need not exist.
[[nodiscard]] std::string follow_links(const std::string& path);

/// Whether both paths lead to one existing file, through symbolic or hard links.
[[nodiscard]] bool is_same_file(const std::string& a, const std::string& b);

/// Gives `to` the permissions of `from`, and its owner where the system permits that. With
/// `writable`, its owner may read and write it in any case. Nothing happens without a `from`.
void copy_permissions(const std::string& from, const std::string& to, bool writable);

/// Renames a complete file to `to`, in the same folder, in one step. Both the file and its new name
/// are durable on return. A file that is replaced passes its permissions on.
/// usage: `to` exists and is to be kept. io: names `to` and the cause; `from` then keeps its name,
/// unless only the folder could not be synced.
[[nodiscard]] Result<void> publish_file(const std::string& from, const std::string& to,
                                        Existing existing);

/// Replaces `path` by `bytes`, or leaves it as it was: writes a temporary in the same folder,
/// syncs, and renames. A symbolic link is written through. A file that is replaced passes its
/// permissions on. io: names the path and the cause; the temporary is gone.
[[nodiscard]] Result<void> write_file(const std::string& path, ByteSpan bytes);

/// The whole file. io: missing, unreadable, a folder. unsupported: longer than `limit` bytes.
[[nodiscard]] Result<Bytes> read_file(const std::string& path, std::uint64_t limit);

}  // namespace slf
