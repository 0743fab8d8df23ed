// A baseline JPEG encoder for mosaics of light fields. It spends no bits on pixels whose content
// does not matter, and weighs the error of every coefficient against its cost in bits.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "codec/jpeg_decode.h"
#include "codec/jpeg_tables.h"

namespace slf::codec {

/// A picture to encode: planes of floats, 0..255, in row order.
struct JpegPicture {
  JpegShape shape;
  /// Grey, or R, G and B: width × height values each.
  std::array<std::vector<float>, 3> planes;
  /// Per pixel, how much its value matters: 0 (not at all) to 1.
  std::vector<float> weight;
};

/// The coefficients of a picture before quantisation. They can be quantised with several sets of
/// tables.
class JpegCoefficients {
 public:
  /// Replaces pixels that do not matter (fill.h), converts to YCbCr and transforms.
  explicit JpegCoefficients(JpegPicture picture);

  struct Block {
    std::array<float, 64> values;  ///< in zigzag order, orthonormal, DC included
    float coverage = 0;            ///< mean weight of its pixels; if 0, `values` is not set
  };
  struct Component {
    std::uint32_t across = 0;  ///< blocks in a row
    std::uint32_t down = 0;
    std::vector<Block> blocks;
  };
  [[nodiscard]] JpegColor color() const { return color_; }
  [[nodiscard]] std::span<const Component> components() const { return components_; }

 private:
  JpegColor color_;
  std::vector<Component> components_;
};

/// How often each symbol of each Huffman table occurs.
struct JpegCounts {
  std::array<SymbolCounts, 2> dc{};
  std::array<SymbolCounts, 2> ac{};
};

/// The squared error that is worth one bit at these quantisation steps.
[[nodiscard]] float error_per_bit(const std::array<std::uint8_t, 64>& steps);

/// Appends the entropy-coded bytes of a picture, and counts its symbols. Either pointer may be
/// null.
/// REQUIRES: is_complete(tables).
void encode_scan(const JpegTables& tables, const JpegCoefficients& picture, Bytes* scan,
                 JpegCounts* counts);

}  // namespace slf::codec
