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

/// unsupported: the field is composed, so no file has its tiles.
[[nodiscard]] Result<void> check_not_composed(const Field& field);

/// The light that a copy keeps: that of its first state, whatever else the copy changes. It is
/// empty if there is none, or if it is to be left out.
[[nodiscard]] Result<ByteSpan> kept_light(const FieldFile& first, const RepackOptions& options);

/// repack_field() of what a file shows, which may be all states if the plan is to copy.
[[nodiscard]] Result<RepackReport> repack_file(const FieldFile& field, const std::string& path,
                                               const RepackOptions& options,
                                               const ProgressCallback& progress);

/// usage: the field does not have a level or subfield. Other errors as repack_field().
[[nodiscard]] Result<RepackPlan> plan_repack(TileCache& tiles, const RepackOptions& options);

/// Reads a stored tile and converts its samples to the plan's format. Errors of TileCache::read().
[[nodiscard]] Result<void> convert_samples(TileCache& tiles, const RepackPlan& plan, TileKey key,
                                           Bytes& samples);

}  // namespace slf
