#include "benchmarks/codec_contenders.h"

#include <cstdio>  // before jpeglib.h, which needs FILE

#include <jpeglib.h>
#include <png.h>
#include <webp/decode.h>
#include <webp/encode.h>
#include <zstd.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <memory>

#include "benchmarks/storage/expect.h"
#include "codec/codec.h"
#include "codec/lane_samples.h"
#include "codec/mosaic.h"
#include "field/field_file.h"

namespace slf::bench {
namespace {

// The colours of tiles as the RGB pictures that peers encode.
struct Mosaics {
  const Field& field;

  codec::Mosaic of(const Sample& sample) const {
    const TileShape tile = field.file().tile_shape(sample.key);
    return {tile.rows(), tile.side, 1};
  }
  // Calls use(sample index, pixel index).
  template <class Use>
  void walk(const Sample& sample, Use use) const {
    const TileShape tile = field.file().tile_shape(sample.key);
    const codec::Mosaic mosaic(tile.rows(), tile.side, 1);
    std::size_t at = 0;
    for (std::size_t row = 0; row < tile.rows(); ++row)
      for (std::uint32_t q = 0; q <= tile.side; ++q) {
        const codec::MosaicLine line = mosaic.line(row, q);
        auto pixel = static_cast<std::ptrdiff_t>(line.start);
        for (std::uint32_t p = 0; p <= tile.side - q; ++p, pixel += line.step)
          use(at++, static_cast<std::size_t>(pixel));
      }
  }
  std::vector<std::uint8_t> rgb(const Sample& sample) const {
    std::vector<std::uint8_t> pixels(of(sample).pixels() * 3);
    walk(sample, [&](std::size_t at, std::size_t pixel) {
      std::memcpy(&pixels[pixel * 3], &sample.color[at * 4], 3);
    });
    return pixels;
  }
  void samples(const Sample& sample, const std::uint8_t* pixels, Bytes& to) const {
    to.resize(sample.color.size());
    walk(sample, [&](std::size_t at, std::size_t pixel) {
      std::memcpy(&to[at * 4], &pixels[pixel * 3], 3);
    });
  }
};

}  // namespace

Contender ours(const Field& field, const std::string& spec, const std::vector<Sample>& samples) {
  const auto shape = [&field](const Sample& sample) {
    TileShape tile = field.file().tile_shape(sample.key);
    tile.format = SampleFormat::rgba8;
    return tile;
  };
  std::vector<codec::TrainingTile> training;
  for (std::size_t i = 0; i < samples.size(); i += 4)
    training.push_back({shape(samples[i]), samples[i].color});
  const std::shared_ptr<codec::Codec> made =
      expect(codec::train_codec(spec, SampleFormat::rgba8, training));
  return {made->spec(),
          [=](const Sample& s, Bytes& to) { expect(made->encode(shape(s), s.color, nullptr, to)); },
          [=](const Sample& s, ByteSpan from, Bytes& to) {
            to.resize(s.color.size());
            expect(made->decode(shape(s), from, nullptr, to));
          },
          made->lossless()};
}

Contender alpha_of_zstd(const Field& field) {
  const auto shape = [&field](const Sample& sample) { return field.file().tile_shape(sample.key); };
  return {"alpha of zstd",
          [=](const Sample& sample, Bytes& to) {
            Bytes alpha;
            for (std::size_t i = 3; i < sample.color.size(); i += 4)
              alpha.push_back(sample.color[i]);
            to.clear();
            expect(codec::append_bytes(shape(sample), alpha, 9, to));
          },
          [=](const Sample& sample, ByteSpan from, Bytes& to) {
            to.resize(sample.color.size());
            Bytes alpha(sample.color.size() / 4);
            expect(codec::read_bytes(shape(sample), from, alpha));
          },
          true};
}

Contender png(const Field& field) {
  const Mosaics mosaics{field};
  const auto image_of = [mosaics](const Sample& sample) {
    png_image image{};
    image.version = PNG_IMAGE_VERSION;
    image.width = static_cast<png_uint_32>(mosaics.of(sample).width());
    image.height = static_cast<png_uint_32>(mosaics.of(sample).height());
    image.format = PNG_FORMAT_RGB;
    return image;
  };
  return {"PNG",
          [=](const Sample& sample, Bytes& to) {
            png_image image = image_of(sample);
            const auto rgb = mosaics.rgb(sample);
            png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(image);
            to.resize(size);
            if (!png_image_write_to_memory(&image, to.data(), &size, 0, rgb.data(), 0, nullptr))
              stop("PNG cannot encode");
            to.resize(size);
          },
          [=](const Sample& sample, ByteSpan from, Bytes& to) {
            png_image image{};
            image.version = PNG_IMAGE_VERSION;
            if (!png_image_begin_read_from_memory(&image, from.data(), from.size()))
              stop("PNG cannot decode");
            std::vector<std::uint8_t> rgb(mosaics.of(sample).pixels() * 3);
            image.format = PNG_FORMAT_RGB;
            png_image_finish_read(&image, nullptr, rgb.data(), 0, nullptr);
            mosaics.samples(sample, rgb.data(), to);
          },
          true};
}

Contender webp(const Field& field, int effort) {
  const Mosaics mosaics{field};
  return {"WebP lossless " + std::to_string(effort),
          [=](const Sample& sample, Bytes& to) {
            WebPConfig config;
            WebPPicture picture;
            WebPMemoryWriter writer;
            if (!WebPConfigInit(&config) || !WebPPictureInit(&picture)) stop("WebP: version");
            WebPConfigLosslessPreset(&config, effort);
            WebPMemoryWriterInit(&writer);
            picture.use_argb = 1;
            picture.width = static_cast<int>(mosaics.of(sample).width());
            picture.height = static_cast<int>(mosaics.of(sample).height());
            picture.writer = WebPMemoryWrite;
            picture.custom_ptr = &writer;
            const auto rgb = mosaics.rgb(sample);
            if (!WebPPictureImportRGB(&picture, rgb.data(), picture.width * 3) ||
                !WebPEncode(&config, &picture))
              stop("WebP cannot encode");
            const auto* bytes = reinterpret_cast<const std::byte*>(writer.mem);
            to.assign(bytes, bytes + writer.size);
            WebPMemoryWriterClear(&writer);
            WebPPictureFree(&picture);
          },
          [=](const Sample& sample, ByteSpan from, Bytes& to) {
            const codec::Mosaic mosaic = mosaics.of(sample);
            std::vector<std::uint8_t> rgb(mosaic.pixels() * 3);
            if (!WebPDecodeRGBInto(reinterpret_cast<const std::uint8_t*>(from.data()), from.size(),
                                   rgb.data(), rgb.size(), static_cast<int>(mosaic.width() * 3)))
              stop("WebP cannot decode");
            mosaics.samples(sample, rgb.data(), to);
          },
          true};
}

Contender libjpeg(const Field& field, int quality, bool full_chroma) {
  const Mosaics mosaics{field};
  return {"libjpeg:" + std::to_string(quality) + (full_chroma ? ":444" : ""),
          [=](const Sample& sample, Bytes& to) {
            jpeg_compress_struct jpeg{};
            jpeg_error_mgr errors{};
            jpeg.err = jpeg_std_error(&errors);
            jpeg_create_compress(&jpeg);
            unsigned char* data = nullptr;
            unsigned long size = 0;
            jpeg_mem_dest(&jpeg, &data, &size);
            jpeg.image_width = static_cast<JDIMENSION>(mosaics.of(sample).width());
            jpeg.image_height = static_cast<JDIMENSION>(mosaics.of(sample).height());
            jpeg.input_components = 3;
            jpeg.in_color_space = JCS_RGB;
            jpeg_set_defaults(&jpeg);
            jpeg_set_quality(&jpeg, quality, TRUE);
            if (full_chroma) jpeg.comp_info[0].h_samp_factor = jpeg.comp_info[0].v_samp_factor = 1;
            jpeg_start_compress(&jpeg, TRUE);
            auto rgb = mosaics.rgb(sample);
            while (jpeg.next_scanline < jpeg.image_height) {
              JSAMPROW row = &rgb[std::size_t{jpeg.next_scanline} * jpeg.image_width * 3];
              jpeg_write_scanlines(&jpeg, &row, 1);
            }
            jpeg_finish_compress(&jpeg);
            jpeg_destroy_compress(&jpeg);
            const auto* bytes = reinterpret_cast<const std::byte*>(data);
            to.assign(bytes, bytes + size);
            std::free(data);
          },
          [=](const Sample& sample, ByteSpan from, Bytes& to) {
            jpeg_decompress_struct jpeg{};
            jpeg_error_mgr errors{};
            jpeg.err = jpeg_std_error(&errors);
            jpeg_create_decompress(&jpeg);
            jpeg_mem_src(&jpeg, reinterpret_cast<const unsigned char*>(from.data()), from.size());
            jpeg_read_header(&jpeg, TRUE);
            jpeg_start_decompress(&jpeg);
            std::vector<std::uint8_t> rgb(mosaics.of(sample).pixels() * 3);
            while (jpeg.output_scanline < jpeg.output_height) {
              JSAMPROW row = &rgb[std::size_t{jpeg.output_scanline} * jpeg.output_width * 3];
              jpeg_read_scanlines(&jpeg, &row, 1);
            }
            jpeg_finish_decompress(&jpeg);
            jpeg_destroy_decompress(&jpeg);
            mosaics.samples(sample, rgb.data(), to);
          }};
}

Contender plain_zstd(const Field& field, int level) {
  const Mosaics mosaics{field};
  return {"plain zstd:" + std::to_string(level),
          [=](const Sample& sample, Bytes& to) {
            const auto rgb = mosaics.rgb(sample);
            to.resize(ZSTD_compressBound(rgb.size()));
            to.resize(ZSTD_compress(to.data(), to.size(), rgb.data(), rgb.size(), level));
          },
          [=](const Sample& sample, ByteSpan from, Bytes& to) {
            std::vector<std::uint8_t> rgb(mosaics.of(sample).pixels() * 3);
            ZSTD_decompress(rgb.data(), rgb.size(), from.data(), from.size());
            mosaics.samples(sample, rgb.data(), to);
          },
          true};
}

/// Differences to the median of the left pixel, the one above, and the plane through both and the
/// one between, in planes of green, red − green, blue − green; then zstd.
Contender median_zstd(const Field& field, int level) {
  const Mosaics mosaics{field};
  using Pixels = std::vector<std::uint8_t>;
  // Calls use(pixel, plane, prediction) in the order of a decoder; `at` has what came before.
  const auto walk = [](std::size_t width, std::size_t pixels, const Pixels& at, auto use) {
    for (std::size_t plane = 0; plane < 3; ++plane)
      for (std::size_t k = 0; k < pixels; ++k) {
        const bool first_row = k < width, first_column = k % width == 0;
        const auto value = [&](std::size_t back) { return int{at[3 * (k - back) + plane]}; };
        const int left = first_column ? (first_row ? 0 : value(width)) : value(1);
        const int above = first_row ? left : value(width);
        const int corner = first_row || first_column ? above : value(width + 1);
        use(k, plane,
            std::clamp(left + above - corner, std::min(left, above), std::max(left, above)));
      }
  };
  return {
      "median zstd:" + std::to_string(level),
      [=](const Sample& sample, Bytes& to) {
        Pixels rgb = mosaics.rgb(sample);
        const std::size_t pixels = rgb.size() / 3;
        for (std::size_t k = 0; k < pixels; ++k) {  // green first, the others less green
          const std::uint8_t green = rgb[3 * k + 1];
          rgb[3 * k + 1] = static_cast<std::uint8_t>(rgb[3 * k] - green);
          rgb[3 * k + 2] = static_cast<std::uint8_t>(rgb[3 * k + 2] - green);
          rgb[3 * k] = green;
        }
        Pixels planes(rgb.size());
        walk(mosaics.of(sample).width(), pixels, rgb,
             [&](std::size_t k, std::size_t plane, int guess) {
               planes[plane * pixels + k] = static_cast<std::uint8_t>(rgb[3 * k + plane] - guess);
             });
        to.resize(ZSTD_compressBound(planes.size()));
        to.resize(ZSTD_compress(to.data(), to.size(), planes.data(), planes.size(), level));
      },
      [=](const Sample& sample, ByteSpan from, Bytes& to) {
        const std::size_t pixels = mosaics.of(sample).pixels();
        Pixels planes(pixels * 3), rgb(pixels * 3);
        ZSTD_decompress(planes.data(), planes.size(), from.data(), from.size());
        walk(mosaics.of(sample).width(), pixels, rgb,
             [&](std::size_t k, std::size_t plane, int guess) {
               rgb[3 * k + plane] = static_cast<std::uint8_t>(planes[plane * pixels + k] + guess);
             });
        for (std::size_t k = 0; k < pixels; ++k) {
          const std::uint8_t green = rgb[3 * k];
          rgb[3 * k] = static_cast<std::uint8_t>(rgb[3 * k + 1] + green);
          rgb[3 * k + 2] = static_cast<std::uint8_t>(rgb[3 * k + 2] + green);
          rgb[3 * k + 1] = green;
        }
        mosaics.samples(sample, rgb.data(), to);
      },
      true};
}

}  // namespace slf::bench
