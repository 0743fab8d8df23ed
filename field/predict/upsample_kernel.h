// Interpolation of a predicted row's opacities and depths between every other column, compiled for
// several instruction sets. Internal.
#pragma once

#include <cstdint>

namespace slf {

/// Fills the columns of a triangle of even `side` from those with even p and q. Each other column
/// lies halfway between two of these. It gets the mean alpha, rounded, and the mean depth of those
/// that are visible. All arrays are read and written up to kPadding beyond their last column.
void upsample_columns(std::uint32_t side, const std::uint8_t* even_alpha,
                      const std::uint8_t* even_depth, std::uint8_t* alpha, std::uint8_t* depth);

}  // namespace slf
