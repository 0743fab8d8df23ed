// Multiplies colours by alpha; compiled for several instruction sets. Private to codec/.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace slf::codec {

/// Multiplies the colour of each pixel by its alpha: colour × alpha / 255, rounded; and stores the
/// alpha. Pixels hold, from the lowest byte on, R, G, B and 255. Thread-safe.
/// REQUIRES: as many pixels as alphas.
void premultiply(std::span<std::uint32_t> pixels, std::span<const std::uint8_t> alpha);

}  // namespace slf::codec
