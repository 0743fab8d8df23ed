// Byte strings as zstd frames. Each thread keeps its compression contexts.
#pragma once

#include <span>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf::codec {

/// Appends `stream`, compressed at `level` or by entropy coding alone, whichever is smaller. An
/// empty stream appends nothing.
[[nodiscard]] Result<void> append_stream(ByteSpan stream, int level, Bytes& to);

/// Decompresses the frame at the start of `bytes` into exactly stream.size() bytes and removes it
/// from `bytes`; untrusted. bad_file: the frame is damaged or has another size.
[[nodiscard]] Result<void> read_stream(ByteSpan& bytes, std::span<std::byte> stream);

}  // namespace slf::codec
