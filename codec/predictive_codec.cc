#include "codec/predictive_codec.h"

namespace slf::codec {
namespace {

tl::unexpected<Error> needs_prediction() {
  return fail(ErrorCode::unsupported, "tiles of a predictive codec are coded by their field");
}

}  // namespace

PredictiveCodec::PredictiveCodec(PredictiveSettings settings, PredictiveTables tables)
    : settings_(settings), tables_(std::move(tables)), bytes_(to_bytes(tables_)) {}

std::string PredictiveCodec::spec() const {
  return "predictive:" + (lossless() ? "lossless" : std::to_string(settings_.quality));
}

const TilePicture& PredictiveCodec::picture(const Tile& tile) const {
  const std::lock_guard lock(mutex_);
  auto& picture = pictures_[{tile.rows(), tile.side}];
  if (!picture) picture = std::make_unique<TilePicture>(tile);
  return *picture;
}

Result<void> PredictiveCodec::encode(const Tile&, ByteSpan, Bytes&) const {
  return needs_prediction();
}

Result<void> PredictiveCodec::decode(const Tile&, ByteSpan, std::span<std::byte>) const {
  return needs_prediction();
}

}  // namespace slf::codec
