// Tiles of the predictive codec without a transform (FORMAT.md, "Channels"): the difference from a
// prediction is coded sample by sample, exactly or within a quantisation step. This serves lossless
// fields and half floats.
#pragma once

#include <cstdint>
#include <span>

#include "base/bytes.h"
#include "codec/codec.h"
#include "codec/prediction.h"
#include "codec/predictive_tables.h"

namespace slf::codec {

/// Encodes the samples of a tile with depths and appends them to `payload`.
void encode_channels(const PredictiveLevel& level, const TileShape& tile, ByteSpan samples,
                     const Predicted& from, Bytes& payload);

/// Undoes encode_channels. bad_file: the payload, untrusted, is longer or shorter than what it
/// codes, or predicted from other tiles.
[[nodiscard]] Result<void> decode_channels(const PredictiveLevel& level, const TileShape& tile,
                                           ByteSpan payload, const Predicted& from,
                                           std::span<std::byte> samples);

}  // namespace slf::codec
