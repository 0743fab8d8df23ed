#include "codec/jpeg_pictures.h"

#include <algorithm>

namespace slf::codec {
namespace {

constexpr std::size_t kMaxExtent = 65500;  // libjpeg's JPEG_MAX_DIMENSION

JpegPicture empty_picture(const Mosaic& mosaic, JpegColor color) {
  JpegPicture picture;
  picture.shape = shape_of(mosaic, color);
  for (std::size_t i = 0; i < (color == JpegColor::gray ? 1u : 3u); ++i)
    picture.planes[i].resize(mosaic.pixels());
  picture.weight.resize(mosaic.pixels());
  return picture;
}

}  // namespace

bool fits_jpeg(const Mosaic& mosaic) {
  return mosaic.width() <= kMaxExtent && mosaic.height() <= kMaxExtent;
}

JpegShape shape_of(const Mosaic& mosaic, JpegColor color) {
  return {static_cast<std::uint32_t>(mosaic.width()), static_cast<std::uint32_t>(mosaic.height()),
          color};
}

JpegPicture gray_picture(const TileShape& tile, const Mosaic& mosaic,
                         std::span<const std::uint8_t> gray, bool zeros_matter) {
  JpegPicture picture = empty_picture(mosaic, JpegColor::gray);
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    picture.planes[0][pixel] = gray[sample];
    picture.weight[pixel] = zeros_matter || gray[sample] != 0 ? 1 : 0;
  });
  return picture;
}

JpegPicture color_picture(const TileShape& tile, const Mosaic& mosaic, JpegColor color,
                          std::span<const std::uint8_t> rgba, std::span<const std::uint8_t> shown) {
  JpegPicture picture = empty_picture(mosaic, color);
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    const std::uint8_t* from = &rgba[sample * 4];
    if (from[3] == 0 || shown[sample] == 0) return;
    const float scale = 255.0f / from[3];
    for (std::size_t i = 0; i < 3; ++i)
      picture.planes[i][pixel] = std::min(from[i] * scale, 255.0f);
    picture.weight[pixel] = from[3] * (1.0f / 255);
  });
  return picture;
}

std::vector<std::uint8_t> alpha_of(std::span<const std::uint8_t> rgba) {
  std::vector<std::uint8_t> alpha(rgba.size() / 4);
  for (std::size_t i = 0; i < alpha.size(); ++i) alpha[i] = rgba[i * 4 + 3];
  return alpha;
}

}  // namespace slf::codec
