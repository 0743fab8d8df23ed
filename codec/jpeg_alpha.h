// Alpha of a JPEG tile: exact, in steps, or as a grey JPEG, whichever costs least.
#pragma once

#include <cstdint>
#include <span>

#include "codec/codec.h"
#include "codec/jpeg_tables.h"
#include "codec/mosaic.h"

namespace slf::codec {

/// Encodes the alpha of a tile, one byte per sample, and appends it to `payload`. Replaces `alpha`
/// by the values that read_jpeg_alpha will decode. With `exact` the coding is lossless.
[[nodiscard]] Result<void> append_jpeg_alpha(const TileShape& tile, const Mosaic& mosaic,
                                             const JpegTables& tables, bool exact,
                                             std::span<std::uint8_t> alpha, Bytes& payload);

/// Fills `alpha` from the start of `payload` and removes the bytes it read; untrusted.
[[nodiscard]] Result<void> read_jpeg_alpha(const TileShape& tile, const Mosaic& mosaic,
                                           const JpegTables& tables, ByteSpan& payload,
                                           std::span<std::uint8_t> alpha);

}  // namespace slf::codec
