// Channels: the colours or the depths of tiles.
#pragma once

#include <string>
#include <vector>

#include "field/tiles/tile_cache.h"

namespace slf {

/// Whether a field has the channel "color" or "depth".
[[nodiscard]] bool has_channel(const FieldFile& field, const std::string& name);

/// The part of a tile's samples that holds a channel.
[[nodiscard]] ByteSpan channel_of(const TileShape& shape, ByteSpan samples, bool depth);

/// Converts a channel, half floats or bytes, to numbers from 0 to 1. Colours of HDR fields may be
/// larger.
void to_floats(bool half, ByteSpan channel, std::vector<float>& numbers);

}  // namespace slf
