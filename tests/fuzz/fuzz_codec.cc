// Codecs: any bytes decode to samples or to an error; lossless codecs give back what they are
// given; shared tables are refused or safe to use.
//
// Input: byte 0 the codec, byte 1 the format, byte 2 rows, byte 3 the side, byte 4 what to do with
// the rest: decode it, encode it as samples, or take it as tables first.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <vector>

#include "codec/codec.h"

namespace {

using namespace slf;
using namespace slf::codec;

constexpr const char* specs[] = {
    "raw", "zstd:1", "zstd:9", "jpeg:75", "jpeg:95:444", "predictive:90", "predictive:lossless"};

std::vector<LocalPoint> positions_of(std::size_t rows) {
  std::vector<LocalPoint> positions;
  for (std::size_t i = 0; i < rows; ++i) positions.push_back({static_cast<std::uint16_t>(i), 0});
  return positions;
}

void decode(const Codec& codec, const TileShape& tile, ByteSpan payload) {
  // Exactly as large as they must be, so that the sanitizer sees every overrun.
  const auto exact = std::make_unique<std::byte[]>(payload.size());
  std::copy(payload.begin(), payload.end(), exact.get());
  const auto samples = std::make_unique<std::byte[]>(tile.bytes());
  (void)codec.decode(tile, {exact.get(), payload.size()}, nullptr, {samples.get(), tile.bytes()});
}

void encode(const Codec& codec, const TileShape& tile, ByteSpan input) {
  Bytes samples(tile.bytes());
  for (std::size_t i = 0; i < samples.size() && !input.empty(); ++i)
    samples[i] = input[i % input.size()];
  Bytes payload, back(tile.bytes());
  if (!codec.encode(tile, samples, nullptr, payload)) return;
  if (!codec.decode(tile, payload, nullptr, back)) std::abort();
  // Codecs that predict do not keep depths of what is not visible.
  if (codec.lossless() && !codec.predicts() && back != samples) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 5) return 0;
  const char* spec = specs[data[0] % std::size(specs)];
  const auto format = static_cast<SampleFormat>(data[1] % 4);
  const std::vector<LocalPoint> positions = positions_of(data[2] % 46);
  const TileShape tile{format, data[3] % 40u, positions};
  const ByteSpan rest = std::as_bytes(std::span(data + 5, size - 5));
  const auto codec = make_codec(spec, format);
  if (!codec) return 0;
  switch (data[4] % 3) {
    case 0:
      decode(**codec, tile, rest);
      break;
    case 1:
      encode(**codec, tile, rest);
      break;
    case 2: {
      const auto other = make_codec(spec, format, rest);
      if (!other) return 0;
      encode(**other, tile, rest);
      decode(**other, tile, rest);
    }
  }
  return 0;
}
