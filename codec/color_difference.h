// Adds differences of colour to predictions (FORMAT.md, "Blocks").
#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace slf::codec {

/// Adds to each pixel a difference in YCbCr, [0] to [2] of `differences`. Pixels hold, from the
/// lowest byte on, R, G, B and the largest value that a channel may get. Compiled for several
/// instruction sets. Thread-safe. REQUIRES: all spans are equally long.
void add_differences(const std::array<std::span<const std::int16_t>, 3>& differences,
                     std::span<std::uint32_t> pixels);

}  // namespace slf::codec
