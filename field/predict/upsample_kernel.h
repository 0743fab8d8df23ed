// Interpolation of a predicted row between every other column, compiled for several instruction
// sets. Internal.
#pragma once

#include <cstdint>

namespace slf {

/// Fills the columns of a triangle of even `side` from those with even p and q. Each other column
/// lies halfway between two of these. It gets the mean alpha, rounded, and the mean depth of those
/// that are visible. All arrays are read and written up to kPadding beyond their last column.
void upsample_columns(std::uint32_t side, const std::uint8_t* even_alpha,
                      const std::uint8_t* even_depth, std::uint8_t* alpha, std::uint8_t* depth);

/// The same for colours of four bytes. The mean is that of the colours whose highest byte is not 0,
/// or of both if it is 0 in both.
void upsample_colors(std::uint32_t side, const std::uint32_t* even, std::uint32_t* colors);

}  // namespace slf
