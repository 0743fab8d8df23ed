// Fill: replaces pixels whose content does not matter by smooth values, which cost few bits.
#pragma once

#include <cstddef>
#include <span>

namespace slf::codec {

/// Blends each value with the mean of its surroundings; at weight 1 the value is kept, at weight 0
/// it is replaced (push-pull over a pyramid: Gortler et al., The Lumigraph, 1996). If all weights
/// are 0, nothing changes. All spans hold width × height values.
void fill(std::size_t width, std::size_t height, std::span<const float> weight,
          std::span<float> values);

}  // namespace slf::codec
