// The predictive codec: any payload decodes against any prediction, without harm; what is encoded
// is accepted; shared tables are refused or safe to use.
//
// Input: byte 0 the rows, byte 1 the side, byte 2 the quality and the scale of steps, byte 3 what
// to do with the rest: decode it, encode it as samples, or take it as tables.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <vector>

#include "codec/predictive.h"

namespace {

using namespace slf;
using namespace slf::codec;

/// A tile whose predictions are made of the input's bytes, over and over.
struct Work {
  explicit Work(const TileShape& tile, ByteSpan bytes)
      : picture(tile),
        alpha(picture.samples()),
        depth(alpha.size()),
        decoded_depth(alpha.size()),
        color(alpha.size()),
        rgba(alpha.size()),
        kinds(23),
        used(kinds.size()) {
    const auto byte = [&](std::size_t k) {
      return bytes.empty() ? 0u : std::to_integer<std::uint32_t>(bytes[k * 7 % bytes.size()]);
    };
    for (std::size_t k = 0; k < alpha.size(); ++k) {
      alpha[k] = static_cast<std::uint8_t>(byte(k)),
      depth[k] = static_cast<std::uint8_t>(byte(k + 1));
      color[k] = byte(k + 2) * 0x01030507u;
    }
    for (std::size_t k = 0; k < kinds.size(); ++k) kinds[k] = k % kReferenceKinds;
  }
  TilePicture picture;
  std::vector<std::uint8_t> alpha, depth, decoded_depth;
  std::vector<std::uint32_t> color, rgba;
  std::vector<std::uint8_t> kinds, used;
};

bool decode(const PredictiveLevel& level, int scale, ByteSpan payload, Work& work) {
  // Exactly as large as it must be, so that the sanitizer sees every overrun.
  const auto exact = std::make_unique<std::byte[]>(payload.size());
  std::copy(payload.begin(), payload.end(), exact.get());
  PredictiveDecoder decoder(level, scale, work.picture, {exact.get(), payload.size()});
  decoder.references(work.kinds, work.used);
  return decoder.decode({work.alpha, work.depth, work.color}, work.decoded_depth, work.rgba)
      .has_value();
}

void encode(const PredictiveLevel& level, int scale, const TileShape& tile, ByteSpan input) {
  Work work(tile, input), truth(tile, input.subspan(input.size() / 2));
  Work back = work;
  for (std::size_t k = 0; k < truth.rgba.size(); ++k) {
    const std::uint32_t a = truth.alpha[k];
    work.rgba[k] = std::min(a, truth.color[k] & 255) * 0x010101u | a << 24;
  }
  Bytes payload;
  PredictiveEncoder encoder(level, scale, work.picture, payload);
  encoder.references(work.kinds, work.used);
  encoder.encode({work.alpha, work.depth, work.color}, truth.depth, work.rgba);
  if (!decode(level, scale, payload, back) || back.used != work.used) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 4) return 0;
  std::vector<LocalPoint> positions(1 + data[0] % 46);
  const TileShape tile{SampleFormat::rgba8_depth8, 1 + data[1] % 33u, positions};
  const ByteSpan rest = std::as_bytes(std::span(data + 4, size - 4));
  const PredictiveTables tables = predictive_tables({1 + data[2] % 100}, 1);
  const int scale = data[2] < 100 ? kPlainScale : data[2] - 99;
  Work work(tile, rest);
  switch (data[3] % 3) {
    case 0:
      (void)decode(tables.level(data[3] / 3 % 2), scale, rest, work);
      break;
    case 1:
      encode(tables.level(1), scale, tile, rest);
      break;
    case 2:
      if (const auto other = parse_predictive_tables(rest)) {
        encode(other->level(1), scale, tile, rest);
        (void)decode(other->level(0), scale, rest, work);
      }
  }
  return 0;
}
