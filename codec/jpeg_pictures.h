// Converts the samples of a tile to the pictures that the jpeg codec encodes.
#pragma once

#include <cstdint>
#include <span>

#include "codec/codec.h"
#include "codec/jpeg_encode.h"
#include "codec/mosaic.h"

namespace slf::codec {

/// Calls use(sample, pixel) for every sample of a tile and its pixel in the mosaic.
template <class Use>
void for_each_sample(const TileShape& tile, const Mosaic& mosaic, Use use) {
  std::size_t sample = 0;
  for (std::size_t row = 0; row < tile.rows(); ++row)
    for (std::uint32_t q = 0; q <= tile.side; ++q) {
      const MosaicLine line = mosaic.line(row, q);
      auto pixel = static_cast<std::ptrdiff_t>(line.start);
      for (std::uint32_t p = 0; p <= tile.side - q; ++p, pixel += line.step)
        use(sample++, static_cast<std::size_t>(pixel));
    }
}

/// Whether JPEG supports pictures of this size.
[[nodiscard]] bool fits_jpeg(const Mosaic& mosaic);

[[nodiscard]] JpegShape shape_of(const Mosaic& mosaic, JpegColor color);

/// Alpha or depth as grey. Pixels have weight 1 but, unless `zeros_matter`, 0 where the value is 0:
/// such a depth is that of nothing.
[[nodiscard]] JpegPicture gray_picture(const TileShape& tile, const Mosaic& mosaic,
                                       std::span<const std::uint8_t> gray, bool zeros_matter);

/// Straight colour, so that a silhouette is no edge in the picture. The weight of a pixel is its
/// alpha, or 0 where `shown`, the alpha that the decoder will have, is 0.
[[nodiscard]] JpegPicture color_picture(const TileShape& tile, const Mosaic& mosaic,
                                        JpegColor color, std::span<const std::uint8_t> rgba,
                                        std::span<const std::uint8_t> shown);

/// The alpha of rgba8 samples.
[[nodiscard]] std::vector<std::uint8_t> alpha_of(std::span<const std::uint8_t> rgba);

}  // namespace slf::codec
