// Mosaic: arranges the triangular pictures of a tile in one rectangle without gaps inside.
//
// Picture 2k is the upper left half of square k. Picture 2k+1 is the lower right half, reflected
// across the hypotenuse, so that the two are nearly equal along the diagonal. Squares are (side+1)
// wide and (side+2) high. They are arranged in rows, alternately from left to right and from right
// to left. Every other square in a row is mirrored left to right, and every other row is upside
// down, so that equal edges meet there too.
#pragma once

#include <cstddef>
#include <cstdint>

#include "codec/codec.h"

namespace slf::codec {

/// The pixels of one line of a picture (its samples of equal q, p ascending) in the rectangle: the
/// sample at p is pixel start + p * step.
struct MosaicLine {
  std::size_t start = 0;
  std::ptrdiff_t step = 1;
};

/// The layout depends on (rows, side, align) only.
class Mosaic {
 public:
  /// Chooses the width and height, multiples of `align`, with the smallest area.
  /// REQUIRES: rows > 0, align > 0.
  Mosaic(std::size_t rows, std::uint32_t side, std::uint32_t align);

  [[nodiscard]] std::size_t width() const { return width_; }
  [[nodiscard]] std::size_t height() const { return height_; }
  [[nodiscard]] std::size_t pixels() const { return width_ * height_; }

  /// REQUIRES: row < rows, q <= side.
  [[nodiscard]] MosaicLine line(std::size_t row, std::uint32_t q) const;

 private:
  std::size_t side_;
  std::size_t across_ = 1;  // squares in a row of squares
  std::size_t width_ = 0;   // 0 without pictures
  std::size_t height_ = 0;
};

}  // namespace slf::codec
