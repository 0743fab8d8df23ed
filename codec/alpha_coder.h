// Alpha, lossless: large flat areas and thin, soft edges.
//
// Where the four neighbours of a sample agree it hardly ever differs, so only the gaps between
// those that do are stored; the samples along edges are predicted, and their residuals sorted by
// what lies around them (FORMAT.md, "Alpha").
#pragma once

#include <cstdint>
#include <span>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf::codec {

/// Appends a stack of triangular pictures of equal side, samples ordered as in Tile. `top` is the
/// value that means opaque.
/// REQUIRES: alpha holds whole pictures and is not empty.
[[nodiscard]] Result<void> append_alpha(std::span<const std::uint8_t> alpha, std::uint32_t side,
                                        std::uint8_t top, Bytes& payload);

/// Fills `alpha` from the start of `payload` and moves `payload` behind it; untrusted.
[[nodiscard]] Result<void> read_alpha(ByteSpan& payload, std::uint32_t side, std::uint8_t top,
                                      std::span<std::uint8_t> alpha);

}  // namespace slf::codec
