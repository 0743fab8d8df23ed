// Composing the samples of one tile of several fields, which are the same rays.
#pragma once

#include <array>
#include <glm/glm.hpp>
#include <span>

#include "base/bytes.h"
#include "slf/tile.h"

namespace slf {

/// A stored tile of a structure, and how it is shown.
struct TileLayer {
  ByteSpan samples;
  glm::vec4 factor{1};  ///< of its premultiplied colours
};

/// The factor of a structure with this opacity and sRGB tint. `linear`: its colours are radiance.
[[nodiscard]] glm::vec4 layer_factor(float opacity, const std::array<float, 3>& tint, bool linear);

/// Composes layers along each ray: the nearest over those behind it, at one depth in the order of
/// `layers`. Depth becomes the mean, weighted by what is visible of each layer. REQUIRES: at least
/// one layer, a format with depth, and equal sizes.
void compose_samples(std::span<const TileLayer> layers, SampleFormat format,
                     std::span<std::byte> samples);

}  // namespace slf
