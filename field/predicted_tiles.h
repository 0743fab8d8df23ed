// PredictedTiles: codes the tiles of a predictive layer. A tile of level l > 0 is coded as what
// differs from a prediction, which its references give: decoded tiles of level l - 1, which its
// payload names (FORMAT.md, "The predictive codec").
//
// Thread-safety: immutable.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "codec/predictive_codec.h"
#include "field/geometry/level_geometry.h"
#include "slf/error.h"
#include "slf/shape.h"

namespace slf {

/// The decoded samples of a tile; null where nothing is visible.
using TileSamples = std::shared_ptr<const Bytes>;

/// Gives a reference's samples. Called on the thread that codes.
using ReferenceSource = std::function<Result<TileSamples>(TileKey)>;

class PredictedTiles {
 public:
  using Geometries = std::function<const LevelGeometry&(unsigned level)>;

  /// Borrows the codec. `geometries` may be called from many threads.
  PredictedTiles(const FieldShape& shape, const codec::PredictiveCodec& codec,
                 Geometries geometries)
      : shape_(shape), codec_(codec), geometries_(std::move(geometries)) {}

  /// The tiles that an untrusted payload refers to, in the order in which they are asked for. Such
  /// a tile may be none of the field's.
  [[nodiscard]] std::vector<TileKey> references(TileKey key, ByteSpan payload) const;

  /// Fills `samples`, exactly the tile's, from an untrusted payload. bad_file: it is damaged.
  [[nodiscard]] Result<void> decode(TileKey key, ByteSpan payload, const ReferenceSource& source,
                                    std::span<std::byte> samples) const;

  /// Replaces `payload`. Refers to those tiles of the field that serve enough of the samples, and
  /// that the source has: its errors of the kind failed mean that it lacks one. `counts`, if given,
  /// counts the decisions of all models, for training.
  [[nodiscard]] Result<void> encode(TileKey key, ByteSpan samples, const ReferenceSource& source,
                                    Bytes& payload, codec::BitCounts* counts = nullptr) const;

 private:
  struct Work;

  const FieldShape shape_;
  const codec::PredictiveCodec& codec_;
  Geometries geometries_;
};

}  // namespace slf
