// PredictiveCodec: codes alpha, depth and colour of a tile as differences from a prediction
// (FORMAT.md, "The predictive codec"), with a transform or sample by sample.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>

#include "codec/codec.h"
#include "codec/predictive.h"
#include "codec/predictive_tables.h"

namespace slf::codec {

class PredictiveCodec final : public Codec {
 public:
  using Observer = std::function<void(const TileSymbols&)>;

  /// `observer`, if any, is told the symbols of each tile that is encoded with a transform, on the
  /// thread that encodes it: for training.
  PredictiveCodec(PredictiveSettings settings, PredictiveTables tables, Observer observer = {});

  [[nodiscard]] std::string spec() const override;
  [[nodiscard]] bool lossless() const override { return settings_.quality == kLosslessQuality; }
  [[nodiscard]] bool predicts() const override { return true; }
  [[nodiscard]] bool four_taps() const override { return !tables_.plain; }
  [[nodiscard]] std::vector<std::uint32_t> blocks(const TileShape& tile) const override;
  [[nodiscard]] bool keeps_rays() const override { return !settings_.by_sample(); }
  [[nodiscard]] ByteSpan tables() const override { return bytes_; }
  [[nodiscard]] std::vector<std::uint8_t> references(unsigned level,
                                                     std::span<const std::uint8_t> kinds,
                                                     ByteSpan payload) const override;
  [[nodiscard]] Result<void> encode(const TileShape& tile, ByteSpan samples,
                                    const Predicted* predicted, Bytes& payload) const override;
  [[nodiscard]] Result<void> decode(const TileShape& tile, ByteSpan payload,
                                    const Predicted* predicted,
                                    std::span<std::byte> samples) const override;

 private:
  [[nodiscard]] int scale(const Predicted& from) const {
    return tables_.plain ? kPlainScale : from.scale;
  }
  void encode_blocks(const TileShape& tile, ByteSpan samples, const Predicted& from,
                     Bytes& payload) const;
  [[nodiscard]] Result<void> decode_blocks(const TileShape& tile, ByteSpan payload,
                                           const Predicted& from,
                                           std::span<std::byte> samples) const;
  /// Made on first use and kept.
  [[nodiscard]] const TilePicture& picture(const TileShape& tile) const;

  PredictiveSettings settings_;
  PredictiveTables tables_;
  Bytes bytes_;
  Observer observer_;
  mutable std::mutex mutex_;
  mutable std::map<std::pair<std::size_t, std::uint32_t>, std::unique_ptr<TilePicture>> pictures_;
};

}  // namespace slf::codec
