// One zstd frame at a time, with contexts that each thread keeps.
#pragma once

#include <span>

#include "base/bytes.h"
#include "base/error.h"

namespace slf::codec {

/// Appends `plain`, compressed at `level`, to `to`.
[[nodiscard]] Result<void> append_zstd(ByteSpan plain, int level, Bytes& to);

/// Decompresses one frame into exactly plain.size() bytes.
/// bad_file: damaged, or of another size.
[[nodiscard]] Result<void> read_zstd(ByteSpan frame, std::span<std::byte> plain);

}  // namespace slf::codec
