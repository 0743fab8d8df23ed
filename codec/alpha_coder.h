// Lossless coder for alpha, which has large flat areas and thin, soft edges.
//
// Where the four neighbours of a sample agree, the sample hardly ever differs from them. So the
// coder stores only the distances between samples that do. It predicts the samples along edges, and
// groups their residuals by the neighbours (FORMAT.md, "Alpha").
#pragma once

#include <cstdint>
#include <span>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf::codec {

/// Encodes a stack of triangular pictures of equal side and appends them to `payload`. Samples are
/// ordered as in Tile. `top` is the value that means opaque.
/// REQUIRES: alpha consists of complete pictures and is not empty.
[[nodiscard]] Result<void> append_alpha(std::span<const std::uint8_t> alpha, std::uint32_t side,
                                        std::uint8_t top, Bytes& payload);

/// Fills `alpha` from the start of `payload` and moves `payload` behind it; untrusted.
[[nodiscard]] Result<void> read_alpha(ByteSpan& payload, std::uint32_t side, std::uint8_t top,
                                      std::span<std::uint8_t> alpha);

}  // namespace slf::codec
