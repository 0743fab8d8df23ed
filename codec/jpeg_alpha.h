// The alpha beside a JPEG picture: in steps, losslessly, or in a gray JPEG, whichever serves best.
#pragma once

#include <cstdint>
#include <span>

#include "codec/codec.h"
#include "codec/jpeg_tables.h"
#include "codec/mosaic.h"

namespace slf::codec {

/// Appends the alpha of a tile, a byte per sample, and replaces it by what read_jpeg_alpha will
/// give. With `exact` alpha stays as it is.
[[nodiscard]] Result<void> append_jpeg_alpha(const Tile& tile, const Mosaic& mosaic,
                                             const JpegTables& tables, bool exact,
                                             std::span<std::uint8_t> alpha, Bytes& payload);

/// Fills `alpha` from the start of `payload` and moves `payload` behind it; untrusted.
[[nodiscard]] Result<void> read_jpeg_alpha(const Tile& tile, const Mosaic& mosaic,
                                           const JpegTables& tables, ByteSpan& payload,
                                           std::span<std::uint8_t> alpha);

}  // namespace slf::codec
