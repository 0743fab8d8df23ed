// PredictiveCodec: the state that all tiles of a field share. Tiles are coded against
// predictions, which only a field can make: see codec/predictive.h and field/tile_coder.h.
#pragma once

#include <map>
#include <memory>
#include <mutex>

#include "codec/codec.h"
#include "codec/predictive.h"
#include "codec/predictive_tables.h"

namespace slf::codec {

class PredictiveCodec final : public Codec {
 public:
  PredictiveCodec(PredictiveSettings settings, PredictiveTables tables);

  [[nodiscard]] std::string spec() const override;
  [[nodiscard]] bool lossless() const override { return settings_.quality == kLosslessQuality; }
  [[nodiscard]] ByteSpan tables() const override { return bytes_; }
  [[nodiscard]] const PredictiveCodec* predictive() const override { return this; }

  [[nodiscard]] const PredictiveSettings& settings() const { return settings_; }
  [[nodiscard]] const PredictiveLevel& level(unsigned index) const { return tables_.level(index); }
  /// Made on first use and kept. Thread-safe.
  [[nodiscard]] const TilePicture& picture(const Tile& tile) const;

  /// unsupported: always, because both need a prediction.
  [[nodiscard]] Result<void> encode(const Tile& tile, ByteSpan samples,
                                    Bytes& payload) const override;
  [[nodiscard]] Result<void> decode(const Tile& tile, ByteSpan payload,
                                    std::span<std::byte> samples) const override;

 private:
  PredictiveSettings settings_;
  PredictiveTables tables_;
  Bytes bytes_;
  mutable std::mutex mutex_;
  mutable std::map<std::pair<std::size_t, std::uint32_t>, std::unique_ptr<TilePicture>> pictures_;
};

}  // namespace slf::codec
