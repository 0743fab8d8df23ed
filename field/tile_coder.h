// TileCoder: codes the tiles of a field with its codec. If that predicts, it makes the predictions
// of tiles of level l > 0 from their references, decoded tiles of level l - 1 that their payloads
// name (FORMAT.md, "The predictive codec").
//
// Thread-safety: immutable.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "codec/codec.h"
#include "field/geometry/level_geometry.h"
#include "slf/error.h"
#include "slf/shape.h"

namespace slf {

/// Returns the decoded samples of a reference, which stay valid until the tile is coded; no bytes
/// if the reference is empty. Called on the thread that codes.
using ReferenceSource = std::function<Result<ByteSpan>(TileKey)>;

class TileCoder {
 public:
  using Geometries = std::function<const LevelGeometry&(unsigned level)>;

  /// The codec must outlive this. `geometries` may be called from many threads.
  TileCoder(const FieldShape& shape, SampleFormat format, const codec::Codec& codec,
            Geometries geometries)
      : shape_(shape), format_(format), codec_(codec), geometries_(std::move(geometries)) {}

  [[nodiscard]] TileShape tile_shape(TileKey key) const {
    return geometries_(key.level).tile(sections_of(key, shape_.entry_extra_levels).entry.index,
                                       format_);
  }

  /// Whether tiles are predicted from coarser ones.
  [[nodiscard]] bool predicts() const { return codec_.predicts(); }

  /// The tiles that an untrusted payload refers to, in the order in which decode() requests them.
  /// The field may not have such a tile.
  [[nodiscard]] std::vector<TileKey> references(TileKey key, ByteSpan payload) const;

  /// Decodes an untrusted payload into `samples`, which has exactly the tile's size. bad_file: the
  /// payload is damaged. Errors of the source.
  [[nodiscard]] Result<void> decode(TileKey key, ByteSpan payload, const ReferenceSource& source,
                                    std::span<std::byte> samples) const;

  /// Encodes samples and replaces `payload`. Refers to the tiles that predict enough of the samples
  /// and that `source` has; an error `tile_missing` of the source means that it lacks a tile.
  [[nodiscard]] Result<void> encode(TileKey key, ByteSpan samples, const ReferenceSource& source,
                                    Bytes& payload) const;

 private:
  class Predictor;  // what the codec asks: finds the references of a tile, loads them, predicts

  const FieldShape shape_;
  const SampleFormat format_;
  const codec::Codec& codec_;
  Geometries geometries_;
};

}  // namespace slf
