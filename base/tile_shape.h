// TileShape: the order of a tile's samples. It is here because geometry makes it and codecs code by
// it, and neither depends on the other. It has no samples.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "slf/tile.h"

namespace slf {

/// The number of vertices of a triangle with `side` cells along each edge, including its border.
[[nodiscard]] constexpr std::uint32_t triangle_size(std::uint32_t side) {
  return (side + 1) * (side + 2) / 2;
}

/// The index of (p, q), p + q <= side, in a triangle stored by lines of constant q, each one sample
/// shorter than the previous one.
[[nodiscard]] constexpr std::uint32_t triangle_index(std::uint32_t side, std::uint32_t p,
                                                     std::uint32_t q) {
  return q * (side + 1) - q * (q - 1) / 2 + p;
}

/// The position of a picture in the stack: integer coordinates on a triangular lattice. Pictures at
/// adjacent positions, which differ by (±1, 0), (0, ±1) or (±1, ∓1), are similar.
struct LocalPoint {
  std::uint16_t p = 0;
  std::uint16_t q = 0;
  friend bool operator==(const LocalPoint&, const LocalPoint&) = default;
};

/// The shape of a tile: positions.size() pictures ("rows"), each a triangle of triangle_size(side)
/// samples ("columns"), in the order of triangle_index(). Samples are stored row after row, all
/// colours before all depths. `positions` is a view and must outlive the TileShape. Positions are
/// distinct and in ascending (q, p) order.
struct TileShape {
  SampleFormat format = SampleFormat::rgba8;
  std::uint32_t side = 0;
  std::span<const LocalPoint> positions;

  [[nodiscard]] std::size_t rows() const { return positions.size(); }
  [[nodiscard]] std::size_t columns() const { return triangle_size(side); }
  [[nodiscard]] std::size_t samples() const { return rows() * columns(); }
  [[nodiscard]] std::size_t bytes() const { return samples() * sample_bytes(format); }
  /// The bytes of all colours; depths follow.
  [[nodiscard]] std::size_t color_bytes() const { return samples() * slf::color_bytes(format); }
};

}  // namespace slf
