#include "codec/mosaic.h"

#include <limits>

namespace slf::codec {
namespace {

std::size_t round_up(std::size_t value, std::size_t align) {
  return (value + align - 1) / align * align;
}

}  // namespace

Mosaic::Mosaic(std::size_t rows, std::uint32_t side, std::uint32_t align) : side_(side) {
  const std::size_t squares = (rows + 1) / 2;
  std::size_t best = std::numeric_limits<std::size_t>::max();
  for (std::size_t across = 1; across <= squares; ++across) {
    const std::size_t down = (squares + across - 1) / across;
    const std::size_t width = round_up(across * (side_ + 1), align);
    const std::size_t height = round_up(down * (side_ + 2), align);
    // Among equal areas prefer the one closest to a square; without this the tallest would win.
    const std::size_t longest = width > height ? width : height;
    const std::size_t cost = width * height + longest;
    if (cost >= best) continue;
    best = cost;
    across_ = across;
    width_ = width;
    height_ = height;
  }
}

MosaicLine Mosaic::line(std::size_t row, std::uint32_t q) const {
  const std::size_t square = row / 2;
  const std::size_t down = square / across_;
  const std::size_t along = square % across_;
  const std::size_t across = down % 2 == 0 ? along : across_ - 1 - along;
  const bool mirrored = across % 2 == 1;
  const bool upside_down = down % 2 == 1;

  // The line's first sample and direction within an unmirrored square.
  const bool reflected = row % 2 == 1;
  const std::size_t x = reflected ? side_ - q : 0;
  const std::size_t y = reflected ? side_ + 1 : q;
  const std::ptrdiff_t stride = static_cast<std::ptrdiff_t>(width_);
  const std::ptrdiff_t step = reflected ? (upside_down ? stride : -stride) : (mirrored ? -1 : 1);

  const std::size_t left = across * (side_ + 1) + (mirrored ? side_ - x : x);
  const std::size_t top = down * (side_ + 2) + (upside_down ? side_ + 1 - y : y);
  return {top * width_ + left, step};
}

}  // namespace slf::codec
