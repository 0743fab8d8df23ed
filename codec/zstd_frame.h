// Byte strings as zstd frames, with contexts that each thread keeps.
#pragma once

#include <span>

#include "base/bytes.h"
#include "base/error.h"

namespace slf::codec {

/// Appends `plane`, compressed at `level` or by entropy coding alone, whichever is smaller. An
/// empty plane appends nothing.
[[nodiscard]] Result<void> append_plane(ByteSpan plane, int level, Bytes& to);

/// Appends all parts, one after the other, as one frame with an entropy code for each. Nothing if
/// all are empty.
[[nodiscard]] Result<void> append_parts(std::span<const ByteSpan> parts, Bytes& to);

/// Decompresses the frame at the start of `bytes` into exactly plane.size() bytes and moves
/// `bytes` behind it; untrusted. bad_file: damaged, or of another size.
[[nodiscard]] Result<void> read_plane(ByteSpan& bytes, std::span<std::byte> plane);

}  // namespace slf::codec
