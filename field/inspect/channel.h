// ChannelReader: a field's colours or depths, tile by tile, whatever layer holds them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "field/field_file.h"

namespace slf {

/// Where a field keeps a channel.
struct Channel {
  storage::LayerId layer = 0;
  SampleFormat format = SampleFormat::rgba8;  ///< rgba8, rgba16f or depth8: of the channel alone
};

/// None if the field has no such channel; "color" and "depth" exist.
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

/// Samples as numbers from 0 to 1; colours of HDR fields may be larger.
void to_floats(SampleFormat format, ByteSpan samples, std::vector<float>& numbers);

}  // namespace slf
