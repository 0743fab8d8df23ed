#include "codec/jpeg_codec.h"

#include <algorithm>
#include <cassert>
#include <cstring>

#include "base/per_thread.h"
#include "base/try.h"
#include "base/varint.h"
#include "codec/color_kernel.h"
#include "codec/jpeg_alpha.h"
#include "codec/jpeg_decode.h"
#include "codec/jpeg_encode.h"
#include "codec/jpeg_pictures.h"
#include "codec/mosaic.h"
#include "codec/scratch.h"

namespace slf::codec {
namespace {

// From this quality on, alpha is exact.
constexpr int kExactAlphaQuality = 95;
// Finer depth does not show in views.
constexpr int kDepthQuality = 75;

std::span<const std::uint8_t> bytes_of(ByteSpan span) {
  return {reinterpret_cast<const std::uint8_t*>(span.data()), span.size()};
}

class JpegCodec final : public Codec {
 public:
  JpegCodec(SampleFormat format, const JpegOptions& options, const JpegTileTables& tables)
      : format_(format),
        options_(options),
        tables_(tables),
        table_bytes_(to_bytes(tables.color)),
        can_encode_(is_complete(tables.color) && is_complete(tables.depth)) {
    if (!has_depth(format)) return;
    const Bytes depth = to_bytes(tables.depth);
    table_bytes_.insert(table_bytes_.end(), depth.begin(), depth.end());
  }

  std::string spec() const override {
    std::string text = "jpeg:" + std::to_string(options_.quality);
    if (options_.color == JpegColor::ycbcr_444) text += ":444";
    return text;
  }
  bool lossless() const override { return false; }
  ByteSpan tables() const override { return table_bytes_; }

  Result<void> encode(const TileShape& tile, ByteSpan samples, const Predicted*,
                      Bytes& payload) const override;
  Result<void> decode(const TileShape& tile, ByteSpan payload, const Predicted*,
                      std::span<std::byte> samples) const override;

 private:
  Result<void> decode_depth(const TileShape& tile, ByteSpan& payload,
                            std::span<std::byte> depths) const;
  Result<void> decode_color(const TileShape& tile, const Mosaic& mosaic, ByteSpan payload,
                            std::span<std::byte> colors) const;

  SampleFormat format_;
  JpegOptions options_;
  JpegTileTables tables_;
  Bytes table_bytes_;
  bool can_encode_;
};

Result<void> JpegCodec::encode(const TileShape& tile, ByteSpan samples, const Predicted*,
                               Bytes& payload) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  payload.clear();
  if (tile.bytes() == 0) return {};
  if (!can_encode_) return bad_file("JPEG", "the shared tables lack codes");
  const Mosaic mosaic(tile.rows(), tile.side, alignment(options_.color));
  if (!fits_jpeg(mosaic))
    return fail(ErrorCode::unsupported, "JPEG: a tile of ", tile.rows(), " pictures of side ",
                tile.side, " is too large");
  const auto colors = bytes_of(samples).first(tile.color_bytes());
  if (has_depth(format_)) {
    const Mosaic depth_mosaic(tile.rows(), tile.side, alignment(JpegColor::gray));
    const auto depths = bytes_of(samples).subspan(tile.color_bytes());
    Bytes scan;
    encode_scan(tables_.depth, JpegCoefficients(gray_picture(tile, depth_mosaic, depths, false)),
                &scan, nullptr);
    append_varint(payload, scan.size());
    payload.insert(payload.end(), scan.begin(), scan.end());
  }
  std::vector<std::uint8_t> alpha = alpha_of(colors);
  const bool exact = options_.quality >= kExactAlphaQuality;
  SLF_TRY(append_jpeg_alpha(tile, mosaic, tables_.color, exact, alpha, payload));
  if (std::all_of(alpha.begin(), alpha.end(), [](auto a) { return a == 0; })) return {};
  encode_scan(tables_.color,
              JpegCoefficients(color_picture(tile, mosaic, options_.color, colors, alpha)),
              &payload, nullptr);
  return {};
}

// Computes samples from the pixels of a mosaic and the alpha of each sample.
void blend(const TileShape& tile, const Mosaic& mosaic, std::span<const std::uint8_t> pixels,
           std::span<const std::uint8_t> alpha, std::span<std::byte> samples) {
  auto& scratch = per_thread<Scratch<std::uint32_t>>([] {});  // `samples` may have any alignment
  const auto words = scratch.take(alpha.size());
  const ByteSpan from = std::as_bytes(pixels);
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    std::memcpy(&words[sample], &from[pixel * 4], 4);
  });
  premultiply(words, alpha);
  std::memcpy(samples.data(), words.data(), samples.size());
}

Result<void> JpegCodec::decode(const TileShape& tile, ByteSpan payload, const Predicted*,
                               std::span<std::byte> samples) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  if (tile.bytes() == 0 && payload.empty()) return {};
  if (tile.bytes() == 0) return bad_file("JPEG", "bytes for a tile without rows");
  const Mosaic mosaic(tile.rows(), tile.side, alignment(options_.color));
  if (!fits_jpeg(mosaic))
    return bad_file("JPEG", "no tile of ", tile.rows(), " pictures of side ", tile.side, " fits");
  if (has_depth(format_)) SLF_TRY(decode_depth(tile, payload, samples.subspan(tile.color_bytes())));
  return decode_color(tile, mosaic, payload, samples.first(tile.color_bytes()));
}

Result<void> JpegCodec::decode_depth(const TileShape& tile, ByteSpan& payload,
                                     std::span<std::byte> depths) const {
  const Mosaic mosaic(tile.rows(), tile.side, alignment(JpegColor::gray));
  const auto size = take_varint(payload);
  if (!size || *size > payload.size()) return bad_file("JPEG", "the tile is cut short");
  auto& scratch = per_thread<Scratch<std::uint8_t>>([] {});
  const auto pixels = scratch.take(mosaic.pixels());
  SLF_TRY(
      decode_scan(tables_.depth, shape_of(mosaic, JpegColor::gray), payload.first(*size), pixels));
  payload = payload.subspan(*size);
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    depths[sample] = static_cast<std::byte>(pixels[pixel]);
  });
  return {};
}

Result<void> JpegCodec::decode_color(const TileShape& tile, const Mosaic& mosaic, ByteSpan payload,
                                     std::span<std::byte> colors) const {
  auto& pixel_scratch = per_thread<Scratch<std::uint8_t>>([] {});
  auto& alpha_scratch = per_thread<Scratch<std::uint8_t>>([] {});
  const std::size_t bytes = mosaic.pixels() * pixel_bytes(options_.color);
  // libjpeg-turbo writes rows that begin at multiples of 32 past the caches, where they are read
  // next: decoding would take a third longer.
  const auto space = pixel_scratch.take(bytes + 32);
  const auto pixels =
      space.subspan((48 - reinterpret_cast<std::uintptr_t>(space.data()) % 32) % 32, bytes);
  const auto alpha = alpha_scratch.take(tile.samples());
  SLF_TRY(read_jpeg_alpha(tile, mosaic, tables_.color, payload, alpha));
  if (payload.empty()) {
    // Only a tile that is transparent everywhere has no picture.
    if (std::any_of(alpha.begin(), alpha.end(), [](auto a) { return a != 0; }))
      return bad_file("JPEG", "the tile is cut short");
    std::fill(colors.begin(), colors.end(), std::byte{0});
    return {};
  }
  SLF_TRY(decode_scan(tables_.color, shape_of(mosaic, options_.color), payload, pixels));
  blend(tile, mosaic, pixels, alpha, colors);
  return {};
}

// Fits the Huffman codes of tables to pictures.
void fit_codes(const std::vector<JpegCoefficients>& pictures, JpegTables& tables) {
  if (pictures.empty()) return;
  // The best levels depend on the code and the best code on the levels, so iterate a few times.
  for (int round = 0; round < 3; ++round) {
    JpegCounts counts;
    for (const JpegCoefficients& picture : pictures) encode_scan(tables, picture, nullptr, &counts);
    for (std::size_t i = 0; i < 2; ++i) {
      tables.dc[i] = optimal_huffman(counts.dc[i], is_dc_symbol);
      tables.ac[i] = optimal_huffman(counts.ac[i], is_ac_symbol);
    }
  }
}

}  // namespace

JpegTileTables standard_tables(const JpegOptions& options) {
  return {standard_tables(options.quality), standard_tables(kDepthQuality)};
}

std::unique_ptr<Codec> make_jpeg_codec(SampleFormat format, const JpegOptions& options,
                                       const JpegTileTables& tables) {
  return std::make_unique<JpegCodec>(format, options, tables);
}

JpegTileTables train_tables(SampleFormat format, const JpegOptions& options,
                            std::span<const TrainingTile> sample) {
  const JpegColor color = options.color;
  std::vector<JpegCoefficients> colors, depths;
  for (const TrainingTile& training : sample) {
    const TileShape& tile = training.tile;
    if (tile.bytes() == 0) continue;
    const Mosaic mosaic(tile.rows(), tile.side, alignment(color));
    if (!fits_jpeg(mosaic)) continue;
    const auto from = bytes_of(training.samples), rgba = from.first(tile.color_bytes());
    colors.emplace_back(color_picture(tile, mosaic, color, rgba, alpha_of(rgba)));
    if (!has_depth(format)) continue;
    const Mosaic depth_mosaic(tile.rows(), tile.side, alignment(JpegColor::gray));
    depths.emplace_back(gray_picture(tile, depth_mosaic, from.subspan(tile.color_bytes()), false));
  }
  JpegTileTables tables = standard_tables(options);
  fit_codes(colors, tables.color);
  fit_codes(depths, tables.depth);
  return tables;
}

}  // namespace slf::codec
