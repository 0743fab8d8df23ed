// RepackPlan: what a repack makes of a field, and its samples.
#pragma once

#include <memory>

#include "field/tiles/tile_cache.h"
#include "slf/repack.h"

namespace slf {

struct RepackPlan {
  FieldShape shape;
  SampleFormat format = SampleFormat::rgba8;
  std::unique_ptr<codec::Codec> codec;  ///< with tables fitted to a sample of the field
  bool copy = false;                    ///< payloads are copied, not recoded

  /// The shape of an output's tile.
  [[nodiscard]] TileShape tile_shape(const FieldFile& field, TileKey key) const {
    TileShape tile = field.tile_shape(key);
    tile.format = format;
    return tile;
  }
};

/// usage: the field does not have a level or subfield. Other errors as repack_field().
[[nodiscard]] Result<RepackPlan> plan_repack(TileCache& tiles, const RepackOptions& options);

/// Reads a stored tile and converts its samples to the plan's format. Errors of TileCache::read().
[[nodiscard]] Result<void> convert_samples(TileCache& tiles, const RepackPlan& plan, TileKey key,
                                           Bytes& samples);

}  // namespace slf
