// Colours times opacity, compiled for several instruction sets. Private to codec/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace slf::codec {

/// Turns opaque pixels, a byte for each of R, G, B and 255 from the lowest on, into premultiplied
/// ones of the given alpha: colour × alpha / 255, rounded. Thread-safe.
/// REQUIRES: as many pixels as alphas.
void premultiply(std::span<std::uint32_t> pixels, std::span<const std::uint8_t> alpha);

}  // namespace slf::codec
