// Whole small files, in and out. Internal to field.
#pragma once

#include <cstdint>
#include <string>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf {

/// Replaces `path` by `bytes`, or leaves it as it was: writes a temporary in the same folder,
/// syncs, and renames. A symbolic link is written through. io: names the path and the cause; the
/// temporary is gone.
[[nodiscard]] Result<void> write_file(const std::string& path, ByteSpan bytes);

/// The whole file. io: missing, unreadable, a folder. unsupported: longer than `limit` bytes.
[[nodiscard]] Result<Bytes> read_file(const std::string& path, std::uint64_t limit);

}  // namespace slf
