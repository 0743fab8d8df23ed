// Lossless coder for alpha, which has large flat areas and thin, soft edges.
//
// Where the four neighbours of a sample are equal, the sample nearly always equals them, too. There
// the coder stores only the distances between the exceptions. Elsewhere, along edges, it predicts
// each sample and groups the residuals by the neighbours (FORMAT.md, "Alpha").
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

/// Fills `alpha` from the start of `payload` and removes the bytes it read; untrusted.
[[nodiscard]] Result<void> read_alpha(ByteSpan& payload, std::uint32_t side, std::uint8_t top,
                                      std::span<std::uint8_t> alpha);

}  // namespace slf::codec
