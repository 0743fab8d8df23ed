// Mosaic: lays the triangular pictures of a tile out in one rectangle, without gaps inside.
//
// Picture 2k takes the upper left half of square k; picture 2k+1 takes the lower right half,
// reflected across the hypotenuse, so that what meets along the diagonal is nearly the same in
// both. Squares are (side+1) wide and (side+2) high, laid in rows, boustrophedon, every other one
// mirrored left to right and every other row of them upside down: equal edges meet there too.
#pragma once

#include <cstddef>
#include <cstdint>

#include "codec/codec.h"

namespace slf::codec {

/// Where one line of a picture (its samples of equal q, p ascending) lies in the rectangle: the
/// sample at p is pixel start + p * step.
struct MosaicLine {
  std::size_t start = 0;
  std::ptrdiff_t step = 1;
};

/// The layout is a function of (rows, side, align) alone.
class Mosaic {
 public:
  /// Width and height come out as multiples of `align`, the smallest area first.
  /// REQUIRES: rows > 0, align > 0.
  Mosaic(std::size_t rows, std::uint32_t side, std::uint32_t align);

  [[nodiscard]] std::size_t width() const { return width_; }
  [[nodiscard]] std::size_t height() const { return height_; }
  [[nodiscard]] std::size_t pixels() const { return width_ * height_; }

  /// REQUIRES: row < rows, q <= side.
  [[nodiscard]] MosaicLine line(std::size_t row, std::uint32_t q) const;

 private:
  std::size_t side_;
  std::size_t across_;  // squares in a row of squares
  std::size_t width_;
  std::size_t height_;
};

}  // namespace slf::codec
