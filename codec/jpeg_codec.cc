#include "codec/jpeg_codec.h"

#include <algorithm>
#include <cassert>
#include <cstring>

#include "codec/jpeg_alpha.h"
#include "codec/jpeg_decode.h"
#include "codec/jpeg_encode.h"
#include "codec/jpeg_pictures.h"
#include "codec/mosaic.h"
#include "codec/premultiply.h"
#include "codec/scratch.h"

namespace slf::codec {
namespace {

// From this quality on, alpha is exact.
constexpr int kExactAlphaQuality = 95;

std::span<const std::uint8_t> bytes_of(ByteSpan span) {
  return {reinterpret_cast<const std::uint8_t*>(span.data()), span.size()};
}

JpegColor color_of(SampleFormat format, const JpegOptions& options) {
  if (format == SampleFormat::depth8) return JpegColor::gray;
  return options.chroma == ChromaSampling::full ? JpegColor::ycbcr_444 : JpegColor::ycbcr_420;
}

class JpegCodec final : public Codec {
 public:
  JpegCodec(SampleFormat format, const JpegOptions& options, const JpegTables& tables)
      : format_(format),
        options_(options),
        color_(color_of(format, options)),
        tables_(tables),
        table_bytes_(to_bytes(tables)),
        can_encode_(is_complete(tables)) {}

  std::string spec() const override {
    std::string text = "jpeg:" + std::to_string(options_.quality);
    if (color_ == JpegColor::ycbcr_444) text += ":444";
    return text;
  }
  bool lossless() const override { return false; }
  ByteSpan tables() const override { return table_bytes_; }

  Result<void> encode(const Tile& tile, ByteSpan samples, Bytes& payload) const override;
  Result<void> decode(const Tile& tile, ByteSpan payload,
                      std::span<std::byte> samples) const override;

 private:
  SampleFormat format_;
  JpegOptions options_;
  JpegColor color_;
  JpegTables tables_;
  Bytes table_bytes_;
  bool can_encode_;
};

Result<void> JpegCodec::encode(const Tile& tile, ByteSpan samples, Bytes& payload) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  payload.clear();
  if (tile.bytes() == 0) return {};
  if (!can_encode_) return fail(ErrorCode::bad_file, "JPEG: the shared tables lack codes");
  const Mosaic mosaic(tile.rows(), tile.side, alignment(color_));
  if (!fits_jpeg(mosaic))
    return fail(ErrorCode::unsupported, "JPEG: a tile of ", tile.rows(), " pictures of side ",
                tile.side, " is too large");
  const std::span<const std::uint8_t> from = bytes_of(samples);
  if (format_ == SampleFormat::depth8) {
    encode_scan(tables_, JpegCoefficients(depth_picture(tile, mosaic, from)), &payload, nullptr);
    return {};
  }
  std::vector<std::uint8_t> alpha = alpha_of(from);
  const bool exact = options_.quality >= kExactAlphaQuality;
  if (auto done = append_jpeg_alpha(tile, mosaic, tables_, exact, alpha, payload); !done)
    return done;
  if (std::all_of(alpha.begin(), alpha.end(), [](auto a) { return a == 0; })) return {};
  encode_scan(tables_, JpegCoefficients(color_picture(tile, mosaic, color_, from, alpha)), &payload,
              nullptr);
  return {};
}

// Computes samples from the pixels of a mosaic and the alpha of each sample.
void blend(const Tile& tile, const Mosaic& mosaic, std::span<const std::uint8_t> pixels,
           std::span<const std::uint8_t> alpha, std::span<std::byte> samples) {
  thread_local Scratch<std::uint32_t> scratch;  // `samples` may have any alignment
  const auto words = scratch.take(alpha.size());
  const ByteSpan from = std::as_bytes(pixels);
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    std::memcpy(&words[sample], &from[pixel * 4], 4);
  });
  premultiply(words, alpha);
  std::memcpy(samples.data(), words.data(), samples.size());
}

Result<void> JpegCodec::decode(const Tile& tile, ByteSpan payload,
                               std::span<std::byte> samples) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  if (tile.bytes() == 0 && payload.empty()) return {};
  if (tile.bytes() == 0) return fail(ErrorCode::bad_file, "JPEG: bytes for a tile without rows");
  const Mosaic mosaic(tile.rows(), tile.side, alignment(color_));
  if (!fits_jpeg(mosaic))
    return fail(ErrorCode::bad_file, "JPEG: no tile of ", tile.rows(), " pictures of side ",
                tile.side, " fits");
  auto* out = reinterpret_cast<std::uint8_t*>(samples.data());
  thread_local Scratch<std::uint8_t> pixel_scratch, alpha_scratch;
  const auto pixels = pixel_scratch.take(mosaic.pixels() * pixel_bytes(color_));
  if (format_ == SampleFormat::depth8) {
    if (auto done = decode_scan(tables_, shape_of(mosaic, color_), payload, pixels); !done)
      return done;
    for_each_sample(tile, mosaic,
                    [&](std::size_t sample, std::size_t pixel) { out[sample] = pixels[pixel]; });
    return {};
  }
  const auto alpha = alpha_scratch.take(tile.rows() * tile.columns());
  if (auto done = read_jpeg_alpha(tile, mosaic, tables_, payload, alpha); !done) return done;
  if (payload.empty()) {
    // Only a tile that is transparent everywhere has no picture.
    if (std::any_of(alpha.begin(), alpha.end(), [](auto a) { return a != 0; }))
      return fail(ErrorCode::bad_file, "JPEG: the tile is cut short");
    std::fill(samples.begin(), samples.end(), std::byte{0});
    return {};
  }
  if (auto done = decode_scan(tables_, shape_of(mosaic, color_), payload, pixels); !done)
    return done;
  blend(tile, mosaic, pixels, alpha, samples);
  return {};
}

}  // namespace

std::unique_ptr<Codec> make_jpeg_codec(SampleFormat format, const JpegOptions& options,
                                       const JpegTables& tables) {
  return std::make_unique<JpegCodec>(format, options, tables);
}

JpegTables train_tables(SampleFormat format, const JpegOptions& options,
                        std::span<const TrainingTile> sample) {
  JpegTables tables = standard_tables(options.quality);
  const JpegColor color = color_of(format, options);
  std::vector<JpegCoefficients> pictures;
  for (const TrainingTile& training : sample) {
    const Tile& tile = training.tile;
    if (tile.bytes() == 0) continue;
    const Mosaic mosaic(tile.rows(), tile.side, alignment(color));
    if (!fits_jpeg(mosaic)) continue;
    const std::span<const std::uint8_t> from = bytes_of(training.samples);
    if (format == SampleFormat::depth8)
      pictures.emplace_back(depth_picture(tile, mosaic, from));
    else
      pictures.emplace_back(color_picture(tile, mosaic, color, from, alpha_of(from)));
  }
  if (pictures.empty()) return tables;
  // The best levels depend on the code and the best code on the levels, so iterate a few times.
  for (int round = 0; round < 3; ++round) {
    JpegCounts counts;
    for (const JpegCoefficients& picture : pictures) encode_scan(tables, picture, nullptr, &counts);
    for (std::size_t i = 0; i < 2; ++i) {
      tables.dc[i] = optimal_huffman(counts.dc[i], is_dc_symbol);
      tables.ac[i] = optimal_huffman(counts.ac[i], is_ac_symbol);
    }
  }
  return tables;
}

}  // namespace slf::codec
