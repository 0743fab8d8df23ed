#include "codec/zstd_codec.h"

#include <cassert>

#include "codec/predict.h"
#include "codec/scratch.h"
#include "codec/zstd_frame.h"

namespace slf::codec {
namespace {

const std::uint8_t* bytes_of(ByteSpan span) {
  return reinterpret_cast<const std::uint8_t*>(span.data());
}

class ZstdCodec final : public Codec {
 public:
  ZstdCodec(SampleFormat format, int level) : format_(format), level_(level) {}

  std::string spec() const override { return "zstd:" + std::to_string(level_); }
  bool lossless() const override { return true; }

  Result<void> encode(const Tile& tile, ByteSpan samples, Bytes& payload) const override;
  Result<void> decode(const Tile& tile, ByteSpan payload,
                      std::span<std::byte> samples) const override;

 private:
  SampleFormat format_;
  int level_;
};

// One byte plane at a time: rgba8 subtracts green from red and blue.
void split_plane(SampleFormat format, std::size_t plane, const std::uint8_t* from,
                 std::size_t count, std::uint8_t* to) {
  const std::size_t stride = sample_bytes(format);
  const bool subtract = format == SampleFormat::rgba8 && (plane == 0 || plane == 2);
  for (std::size_t i = 0; i < count; ++i)
    to[i] = static_cast<std::uint8_t>(from[i * stride + plane] - (subtract ? from[i * 4 + 1] : 0));
}

Result<void> ZstdCodec::encode(const Tile& tile, ByteSpan samples, Bytes& payload) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  payload.clear();
  if (tile.bytes() == 0) return {};
  thread_local Scratch<std::uint8_t> plane_scratch, residual_scratch;
  const std::size_t columns = tile.columns();
  const std::span<std::uint8_t> plane = plane_scratch.take(columns);
  const std::span<std::uint8_t> residuals = residual_scratch.take(tile.bytes());
  for (std::size_t channel = 0; channel < sample_bytes(format_); ++channel)
    for (std::size_t row = 0; row < tile.rows(); ++row) {
      split_plane(format_, channel, bytes_of(samples) + row * columns * sample_bytes(format_),
                  columns, plane.data());
      predict(plane, tile.side,
              residuals.subspan((channel * tile.rows() + row) * columns, columns));
    }
  return append_zstd(std::as_bytes(residuals), level_, payload);
}

Result<void> ZstdCodec::decode(const Tile& tile, ByteSpan payload,
                               std::span<std::byte> samples) const {
  assert(tile.format == format_ && samples.size() == tile.bytes());
  if (tile.bytes() == 0 && payload.empty()) return {};
  thread_local Scratch<std::uint8_t> plane_scratch, residual_scratch;
  const std::size_t columns = tile.columns();
  const std::size_t stride = sample_bytes(format_);
  const std::span<std::uint8_t> plane = plane_scratch.take(columns);
  const std::span<std::uint8_t> residuals = residual_scratch.take(tile.bytes());
  if (auto read = read_zstd(payload, std::as_writable_bytes(residuals)); !read) return read;
  auto* out = reinterpret_cast<std::uint8_t*>(samples.data());
  for (std::size_t channel = 0; channel < stride; ++channel)
    for (std::size_t row = 0; row < tile.rows(); ++row) {
      restore(residuals.subspan((channel * tile.rows() + row) * columns, columns), tile.side,
              plane);
      std::uint8_t* to = out + row * columns * stride + channel;
      for (std::size_t i = 0; i < columns; ++i) to[i * stride] = plane[i];
    }
  if (format_ == SampleFormat::rgba8)
    for (std::size_t i = 0; i < samples.size(); i += 4) {
      out[i] = static_cast<std::uint8_t>(out[i] + out[i + 1]);
      out[i + 2] = static_cast<std::uint8_t>(out[i + 2] + out[i + 1]);
    }
  return {};
}

}  // namespace

std::unique_ptr<Codec> make_zstd_codec(SampleFormat format, int level) {
  return std::make_unique<ZstdCodec>(format, level);
}

}  // namespace slf::codec
