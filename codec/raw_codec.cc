#include "codec/raw_codec.h"

#include <algorithm>
#include <cassert>

namespace slf::codec {
namespace {

class RawCodec final : public Codec {
 public:
  std::string spec() const override { return "raw"; }
  bool lossless() const override { return true; }
  bool in_place() const override { return true; }

  Result<void> encode(const TileShape& tile, ByteSpan samples, const Predicted*,
                      Bytes& payload) const override {
    assert(samples.size() == tile.bytes());
    (void)tile;
    payload.assign(samples.begin(), samples.end());
    return {};
  }

  Result<void> decode(const TileShape& tile, ByteSpan payload, const Predicted*,
                      std::span<std::byte> samples) const override {
    assert(samples.size() == tile.bytes());
    if (payload.size() != tile.bytes())
      return fail(ErrorCode::bad_file, "raw tile: expected ", tile.bytes(), " bytes, found ",
                  payload.size());
    std::copy(payload.begin(), payload.end(), samples.begin());
    return {};
  }
};

}  // namespace

std::unique_ptr<Codec> make_raw_codec() { return std::make_unique<RawCodec>(); }

}  // namespace slf::codec
