// Interpolation of a predicted row between every other column, compiled for several instruction
// sets. Internal.
#pragma once

#include <cstddef>
#include <cstdint>

namespace slf {

/// Fills the columns of a triangle of even `side` from those with even p and q. Each other column
/// lies halfway between two of these. It gets the mean alpha, rounded, and the mean depth of those
/// that are visible. All arrays are read and written up to kPadding beyond their last column.
void upsample_columns(std::uint32_t side, const std::uint8_t* even_alpha,
                      const std::uint8_t* even_depth, std::uint8_t* alpha, std::uint8_t* depth);

/// Lines of a triangle of this side, side / 2, are so far apart in `even` of upsample_colors().
constexpr std::size_t upsample_stride(std::uint32_t side) { return side / 2 + 2; }

/// The same for colours of four bytes. The mean is that of the colours whose highest byte is not 0,
/// or of both if it is 0 in both. `four_taps`: if it is not 0 in four colours on a line, the one in
/// their middle gets an eighth of the difference of the inner and the outer mean more. `even`
/// points to the first colour of a line that has zeros before and behind it, as all have, and a
/// line of zeros above and below them.
void upsample_colors(std::uint32_t side, bool four_taps, const std::uint32_t* even,
                     std::uint32_t* colors);

}  // namespace slf
