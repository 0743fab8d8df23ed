#include "codec/jpeg_codec.h"

#include <algorithm>
#include <cassert>

#include "codec/jpeg_scan.h"
#include "codec/mosaic.h"
#include "codec/predict.h"
#include "codec/scratch.h"
#include "codec/zstd_frame.h"

namespace slf::codec {
namespace {

constexpr int alpha_level = 9;
constexpr std::size_t max_extent = 65500;  // libjpeg's JPEG_MAX_DIMENSION

const std::uint8_t* bytes_of(ByteSpan span) {
  return reinterpret_cast<const std::uint8_t*>(span.data());
}

class JpegCodec final : public Codec {
 public:
  JpegCodec(SampleFormat format, const JpegOptions& options, const JpegTables& tables)
      : format_(format), options_(options), tables_(tables), table_bytes_(to_bytes(tables)) {}

  std::string spec() const override {
    std::string text = "jpeg:" + std::to_string(options_.quality);
    if (format_ == SampleFormat::rgba8 && options_.chroma == ChromaSampling::full) text += ":444";
    return text;
  }
  bool lossless() const override { return false; }
  ByteSpan tables() const override { return table_bytes_; }

  Result<void> encode(const Tile& tile, ByteSpan samples, Bytes& payload) const override;
  Result<void> decode(const Tile& tile, ByteSpan payload,
                      std::span<std::byte> samples) const override;

 private:
  JpegColor color() const {
    return format_ == SampleFormat::depth8           ? JpegColor::gray
           : options_.chroma == ChromaSampling::full ? JpegColor::ycbcr_444
                                                     : JpegColor::ycbcr_420;
  }
  std::uint32_t align() const { return color() == JpegColor::ycbcr_420 ? 16 : 8; }

  SampleFormat format_;
  JpegOptions options_;
  JpegTables tables_;
  Bytes table_bytes_;
};

// Calls use(sample index, pixel index) for every sample of a tile.
template <class Use>
void for_each_sample(const Tile& tile, const Mosaic& mosaic, Use use) {
  std::size_t sample = 0;
  for (std::size_t row = 0; row < tile.rows(); ++row)
    for (std::uint32_t q = 0; q <= tile.side; ++q) {
      const MosaicLine line = mosaic.line(row, q);
      auto pixel = static_cast<std::ptrdiff_t>(line.start);
      for (std::uint32_t p = 0; p <= tile.side - q; ++p, pixel += line.step)
        use(sample++, static_cast<std::size_t>(pixel));
    }
}

JpegShape shape_of(const Mosaic& mosaic, JpegColor color) {
  return {static_cast<std::uint32_t>(mosaic.width()), static_cast<std::uint32_t>(mosaic.height()),
          color};
}

// Alpha, lossless: predicted, then zstd.
Result<void> append_alpha(const Tile& tile, const std::uint8_t* rgba, Bytes& to) {
  thread_local Scratch<std::uint8_t> plane_scratch, residual_scratch;
  const std::size_t columns = tile.columns();
  const auto plane = plane_scratch.take(columns);
  const auto residuals = residual_scratch.take(tile.rows() * columns);
  for (std::size_t row = 0; row < tile.rows(); ++row) {
    for (std::size_t i = 0; i < columns; ++i) plane[i] = rgba[(row * columns + i) * 4 + 3];
    predict(plane, tile.side, residuals.subspan(row * columns, columns));
  }
  return append_zstd(std::as_bytes(residuals), alpha_level, to);
}

Result<void> read_alpha(const Tile& tile, ByteSpan frame, std::uint8_t* rgba) {
  thread_local Scratch<std::uint8_t> plane_scratch, residual_scratch;
  const std::size_t columns = tile.columns();
  const auto plane = plane_scratch.take(columns);
  const auto residuals = residual_scratch.take(tile.rows() * columns);
  if (auto read = read_zstd(frame, std::as_writable_bytes(residuals)); !read) return read;
  for (std::size_t row = 0; row < tile.rows(); ++row) {
    restore(residuals.subspan(row * columns, columns), tile.side, plane);
    for (std::size_t i = 0; i < columns; ++i) rgba[(row * columns + i) * 4 + 3] = plane[i];
  }
  return {};
}

Result<void> JpegCodec::encode(const Tile& tile, ByteSpan samples, Bytes& payload) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  payload.clear();
  if (tile.bytes() == 0) return {};
  const Mosaic mosaic(tile.rows(), tile.side, align());
  if (mosaic.width() > max_extent || mosaic.height() > max_extent)
    return fail(ErrorCode::unsupported, "JPEG: a tile of ", tile.rows(), " pictures of side ",
                tile.side, " is too large");
  const std::size_t stride = pixel_bytes(color());
  thread_local Scratch<std::uint8_t> scratch;
  const auto pixels = scratch.take(mosaic.pixels() * stride);
  std::fill(pixels.begin(), pixels.end(), std::uint8_t{0});
  const std::uint8_t* from = bytes_of(samples);
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    std::copy_n(from + sample * stride, stride, pixels.data() + pixel * stride);
  });
  if (format_ == SampleFormat::depth8)
    return append_scan(tables_, shape_of(mosaic, color()), pixels, payload);

  payload.resize(4);
  if (auto done = append_scan(tables_, shape_of(mosaic, color()), pixels, payload); !done)
    return done;
  store_le<std::uint32_t>(payload.data(), static_cast<std::uint32_t>(payload.size() - 4));
  return append_alpha(tile, from, payload);
}

Result<void> JpegCodec::decode(const Tile& tile, ByteSpan payload,
                               std::span<std::byte> samples) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  if (tile.bytes() == 0 && payload.empty()) return {};
  if (tile.bytes() == 0) return fail(ErrorCode::bad_file, "JPEG: bytes for a tile without rows");
  const Mosaic mosaic(tile.rows(), tile.side, align());
  if (mosaic.width() > max_extent || mosaic.height() > max_extent)
    return fail(ErrorCode::bad_file, "JPEG: no tile of ", tile.rows(), " pictures of side ",
                tile.side, " fits");
  auto* out = reinterpret_cast<std::uint8_t*>(samples.data());
  ByteSpan scan = payload;
  if (format_ == SampleFormat::rgba8) {
    if (payload.size() < 4) return fail(ErrorCode::bad_file, "JPEG: the tile is cut short");
    const std::size_t size = load_le<std::uint32_t>(payload.data());
    if (size > payload.size() - 4) return fail(ErrorCode::bad_file, "JPEG: the tile is cut short");
    scan = payload.subspan(4, size);
  }
  const std::size_t stride = pixel_bytes(color());
  thread_local Scratch<std::uint8_t> scratch;
  const auto pixels = scratch.take(mosaic.pixels() * stride);
  if (auto done = read_scan(tables_, shape_of(mosaic, color()), scan, pixels); !done) return done;
  if (format_ == SampleFormat::depth8) {
    for_each_sample(tile, mosaic,
                    [&](std::size_t sample, std::size_t pixel) { out[sample] = pixels[pixel]; });
    return {};
  }
  if (auto done = read_alpha(tile, payload.subspan(4 + scan.size()), out); !done) return done;
  for_each_sample(tile, mosaic, [&](std::size_t sample, std::size_t pixel) {
    std::uint8_t* to = out + sample * 4;
    for (int c = 0; c < 3; ++c) to[c] = std::min(pixels[pixel * 4 + c], to[3]);
  });
  return {};
}

}  // namespace

std::unique_ptr<Codec> make_jpeg_codec(SampleFormat format, const JpegOptions& options,
                                       const JpegTables& tables) {
  return std::make_unique<JpegCodec>(format, options, tables);
}

}  // namespace slf::codec
