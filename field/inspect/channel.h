// ChannelReader: reads colours or depths of tiles, from a layer of their own or a combined one.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "field/field_file.h"

namespace slf {

/// The layer and format of a channel in a field.
struct Channel {
  storage::LayerId layer = 0;
  SampleFormat format = SampleFormat::rgba8;  ///< rgba8, rgba16f or depth8: of the channel alone
};

/// Finds the channel "color" or "depth". None if the field does not have it.
[[nodiscard]] std::optional<Channel> find_channel(const FieldFile& field, const std::string& name);

/// Reads samples of one field on one thread. A tile that holds several channels is decoded once.
class ChannelReader {
 public:
  explicit ChannelReader(const FieldFile& field) : field_(field) {}

  /// The channel's part of a stored tile's samples; all zeros for an empty tile. Valid until the
  /// next call. Errors of FieldFile::decode().
  [[nodiscard]] Result<ByteSpan> read(const Channel& channel, const storage::TileRef& tile);

 private:
  const FieldFile& field_;
  std::optional<std::pair<storage::LayerId, TileKey>> decoded_;
  Bytes samples_, zeros_;
};

/// Converts samples to numbers from 0 to 1. Colours of HDR fields may be larger.
void to_floats(SampleFormat format, ByteSpan samples, std::vector<float>& numbers);

}  // namespace slf
