// Fill: smooth values for the pixels of a picture that do not matter.
#pragma once

#include <cstddef>
#include <span>

namespace slf::codec {

/// Blends each value towards the mean of its surroundings as its weight goes from 1 to 0
/// (push-pull over a pyramid: Gortler et al., The Lumigraph, 1996). Without any weight the values
/// are left alone. All spans hold width × height values.
void fill(std::size_t width, std::size_t height, std::span<const float> weight,
          std::span<float> values);

}  // namespace slf::codec
