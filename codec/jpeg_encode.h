// A baseline JPEG encoder for mosaics of light fields: it spends no bits on pixels that do not
// matter, and weighs every coefficient's error against the bits it costs.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "codec/jpeg_decode.h"
#include "codec/jpeg_tables.h"

namespace slf::codec {

/// A picture to encode: planes of floats, 0..255, row by row.
struct JpegPicture {
  JpegShape shape;
  /// Gray, or R, G and B: width × height values each.
  std::array<std::vector<float>, 3> planes;
  /// Per pixel, 0 where the value does not matter, up to 1.
  std::vector<float> weight;
};

/// The coefficients of a picture before quantisation, for quantising it with one set of tables
/// after the other.
class JpegCoefficients {
 public:
  /// Fills in what does not matter, converts to YCbCr and transforms.
  explicit JpegCoefficients(JpegPicture picture);

  struct Block {
    std::array<float, 64> values;  ///< in zigzag order, orthonormal, DC included
    float coverage = 0;            ///< mean weight of its pixels; at 0 there are no values
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

/// How often each symbol of each Huffman table is used.
struct JpegCounts {
  std::array<SymbolCounts, 2> dc{};
  std::array<SymbolCounts, 2> ac{};
};

/// The squared error that is worth a bit at these quantisation steps.
[[nodiscard]] float error_per_bit(const std::array<std::uint8_t, 64>& steps);

/// Appends the entropy-coded bytes of a picture and adds to `counts`, either of which may be null.
/// REQUIRES: is_complete(tables).
void encode_scan(const JpegTables& tables, const JpegCoefficients& picture, Bytes* scan,
                 JpegCounts* counts);

}  // namespace slf::codec
